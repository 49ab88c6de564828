"""The paper's claims about its simulated evaluation, each with the statistic that decides it, as a table.

    python -m analysis.claims results/runs --notes results/notes.yaml
    python -m analysis.claims paper=runs/paper published=runs/published default=results/runs

A statistic's interval holds the middle 95 % of a bootstrap over runs and problems. A claim holds if the whole interval
is on its side of the bound, fails if all of it is on the other side, and is undecided otherwise; `needed` says how many
runs of each would decide. Runs that were evaluated otherwise than `sweeps/protocol.yaml` says decide nothing. Each NAME
has columns of its own. The table is written as OUT.csv, and for reading as OUT.md.
"""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.commands import by_name, finished_runs, named, one_line_errors, parser_of
from analysis.evidence import Evidence
from analysis.statements import CLAIMS
from analysis.verdicts import DECIDED
from apf.errors import InputError
from apf.rundir.files import read_yaml

COLUMNS = ["claim", "section", "statistic"]
"""What a row says of the claim itself. `DECIDED` follow, for each name."""
READING = (
    "# The paper's claims, decided",
    "",
    "Evidence: a number, its 95 % interval over runs and problems, and what the number should be if the claim is true.",
    "A claim holds, or fails, if the whole interval says so; otherwise it is undecided. Made by `analysis/claims.py`.",
    "",
)
"""What the table for reading begins with."""


def table_of_claims(evidence: Mapping[str, Evidence], draws: int) -> pd.DataFrame:
    """One row for each claim: `COLUMNS`, then `DECIDED` for each name, as NAME.value; without NAME for the empty name.

    Args:
        evidence: By name.
        draws: Bootstrap samples.
    """
    rngs = {name: np.random.default_rng(0) for name in evidence}
    rows = []
    for section, claims in CLAIMS.items():
        for claim in claims:
            row: dict[str, object] = {"claim": claim.text, "section": section, "statistic": claim.rule}
            for name, of_name in evidence.items():
                decision = claim.decide(of_name, draws, rngs[name])
                row |= {column_of(name, key): decision[key] for key in DECIDED}
            rows.append(row)
    return pd.DataFrame(rows)


def column_of(name: str, key: str) -> str:
    """The column of a name."""
    return f"{name}.{key}" if name else key


def add_notes(table: pd.DataFrame, path: Path, name: str = "") -> None:
    """Put what is known about claims, a YAML file of notes by claim, into the table.

    Args:
        table: Of `table_of_claims`.
        path: The file.
        name: Whose notes these are.

    Raises:
        InputError: There is no such claim or name in the table.
    """
    notes, column = read_yaml(path), column_of(name, "note")
    if column not in table:
        raise InputError(f"--notes {path}: there are no runs of that name; write NAME=FILE, as with the runs")
    for claim, note in notes.items():
        rows = table["claim"] == claim
        if not rows.any():
            raise InputError(f"{path}: no such claim: {claim}")
        table.loc[rows, column] = [f"{missing}; {note}" if missing else note for missing in table.loc[rows, column]]


def markdown(table: pd.DataFrame, names: Sequence[str]) -> str:
    """The table for reading: claim, answer and evidence.

    Args:
        table: Of `table_of_claims`.
        names: Of the groups of runs in it.
    """
    lines = [*READING]
    for section in dict.fromkeys(table["section"]):
        heads = [f"{name}: {head}" if name else head for name in names for head in ("answer", "evidence")]
        lines += [
            f"## {section[0].upper()}{section[1:]}",
            "",
            _line(["claim", *heads]),
            _line(["---"] * (len(heads) + 1)),
        ]
        for _, row in table[table["section"] == section].iterrows():
            cells = [(row[column_of(name, "verdict")], _evidence(row, name)) for name in names]
            lines.append(_line([row["claim"], *(text for cell in cells for text in cell)]))
        lines.append("")
    return "\n".join(lines)


def _evidence(row: pd.Series, name: str) -> str:
    """What was measured, with its interval, what it should be, of how many runs, and what else is known."""
    value, low, high, runs, _, needed, note = (row[column_of(name, key)] for key in DECIDED)
    statistic, sign, bound = re.split(" ([<>]) (?=[^<>]*$)", row["statistic"])
    measured = f"{statistic}: {value:z.2f} ({low:z.2f} to {high:z.2f}), should be {sign} {bound}"
    counted = f"{runs} run{'s' * (runs != '1')}" + (f", {needed} of each would decide" if needed else "")
    return "; ".join([measured, counted] * bool(pd.notna(value)) + [str(note)] * bool(note))


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def main() -> None:
    """Write the table of claims for the runs on the command line."""
    parser = parser_of(__doc__, names="optional")
    parser.add_argument("--out", type=Path, help="CSV to write (default: claims.csv in the common folder of the DIRs)")
    parser.add_argument(
        "--notes", action="append", default=[], metavar="[NAME=]FILE", help="YAML file with notes by claim"
    )
    parser.add_argument("--draws", type=int, default=1000, help="bootstrap samples (default: %(default)s)")
    arguments = parser.parse_args()
    with one_line_errors():
        folders = by_name(arguments.directories)
        evidence = {name: Evidence.of(finished_runs(of_name)) for name, of_name in folders.items()}
        table = table_of_claims(evidence, arguments.draws)
        for text in arguments.notes:
            name, path = named(text, optional=True)
            add_notes(table, path, name)
        out = arguments.out or common_folder([path for of_name in folders.values() for path in of_name]) / "claims.csv"
        out.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(out, index=False, float_format="%.3f")
        out.with_suffix(".md").write_text(markdown(table, list(folders)), encoding="utf-8")
    print(*(f"{name or 'verdict':10}" for name in folders), "claim")
    for row in table.to_dict("records"):
        print(*(f"{row[column_of(name, 'verdict')]:10}" for name in folders), row["claim"])
    print(out, out.with_suffix(".md"), sep="\n")


def common_folder(directories: Sequence[Path]) -> Path:
    """The folder that holds all of these: of a single one, this itself."""
    return Path(os.path.commonpath([directory.resolve() for directory in directories]))


if __name__ == "__main__":
    main()
