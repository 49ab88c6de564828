"""python -m apf.evaluate run=DIR world=NAME: a finished run's ensemble chooses plans, and another world executes them.

The command is short for `python -m apf.main predictor=trained predictor.run=DIR world=NAME`, with that world alone in
`evaluation.worlds`. Any other override is passed on.
"""

import sys
from collections.abc import Sequence

from apf.errors import InputError
from apf.main import main as run_main


def translated(arguments: Sequence[str]) -> list[str]:
    """The overrides of `apf.main` for the arguments of this command. Raises InputError if run or world is missing."""
    given = dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    for key in ("run", "world"):
        if not given.get(key):
            raise InputError(f"{key}=... is missing: python -m apf.evaluate run=DIR world=NAME")
    world = given["world"]
    ours = {"run": "predictor.run", "step": "predictor.step"}
    rest = [argument for argument in arguments if argument.split("=", 1)[0] not in ours]
    return [
        "predictor=trained",
        *(f"{name}={given[key]}" for key, name in ours.items() if key in given),
        "~world@evaluation.worlds.analytic",
        "~world@evaluation.worlds.noisy",
        f"+evaluation.worlds.{world}=${{world}}",
        *rest,
    ]


def main() -> None:
    """Entry point of the command."""
    if not {"-h", "--help", "--version", "-sc", "--shell-completion"} & set(sys.argv):
        try:
            sys.argv[1:] = translated(sys.argv[1:])
        except InputError as error:
            sys.exit(f"error: {error}")
    run_main()


if __name__ == "__main__":
    main()
