"""The sweeps of the paper's figures and tables, and candidate sources that only a sweep needs."""
