"""python -m apf.panda.sheets blocks=FILE: sheets with the markers of real blocks, to be printed and cut out."""

from pathlib import Path

from omegaconf import DictConfig

from apf.config.build import build
from apf.errors import InputError
from apf.panda.vision.sheets import drawn_sheets
from apf.rundir.files import make_folder, replacing
from apf.settings import settings
from apf.towers import BlockSet, read_blocks


@settings
class SheetsConfig:
    """What the command is given; the comments in `conf/sheets.yaml` say what for."""

    blocks: Path
    out: Path


def work(cfg: DictConfig) -> None:
    """Read the blocks, write the sheets. Raises InputError for what is wrong with the input."""
    config = build(cfg, SheetsConfig)
    if config.out.suffix != ".pdf":
        raise InputError(f"out={config.out}: the ending must be .pdf")
    blocks = read_blocks(config.blocks)
    sheets = write_sheets(blocks, config.out)
    print(f"{config.out}: markers of {len(blocks)} blocks on {sheets} sheets of A4; print at 100 %")


def write_sheets(blocks: BlockSet, path: Path) -> int:
    """Write a PDF file with the markers of a set. Returns the number of sheets.

    Raises:
        InputError: A face is larger than a sheet, there are more blocks than markers, or the file cannot be written.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    figures = list(drawn_sheets(blocks))
    try:
        make_folder(path.parent)
        with replacing(path) as half, half.open("wb") as file, PdfPages(file, metadata={"CreationDate": None}) as pdf:
            for figure in figures:
                pdf.savefig(figure)
    except OSError as error:
        raise InputError(f"out={path}: cannot be written: {error.strerror or error}") from None
    return len(figures)
