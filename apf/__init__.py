"""Active learning of abstract plan feasibility (Noseworthy, Moses, Brand et al., RSS 2021)."""

__version__ = "0.1.0"
