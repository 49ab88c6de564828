"""python tests/lowest.py: the quick tests, with the lowest version that each dependency may have.

pip makes an environment in a temporary folder, which takes minutes and a few GB; it is removed at the end. What follows
`--` goes to pytest. The exit code is pytest's.

Where a lowest version cannot be installed, `--instead torch==2.13.0` takes another version that pyproject.toml allows.
"""

import argparse
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

REPOSITORY = Path(__file__).parents[1]


def lowest(extras: Sequence[str]) -> list[str]:
    """What this package and its extras require, each pinned to its lower bound. Raises ValueError if one has none."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    wanted, pins = [*project["dependencies"]], []
    for extra in extras:
        wanted += project["optional-dependencies"][extra]
    for text in dict.fromkeys(wanted):
        requirement = Requirement(text)
        if requirement.name == project["name"]:
            pins += [pin for pin in lowest(sorted(requirement.extras)) if pin not in pins]
            continue
        bounds = [part.version for part in requirement.specifier if part.operator == ">="]
        if not bounds:
            raise ValueError(f"{text}: it has no lower bound")
        pins.append(f"{requirement.name}=={bounds[0]}")
    return list(dict.fromkeys(pins))


def instead(pins: Sequence[str], others: Sequence[str]) -> list[str]:
    """The pins with other versions of some packages. Raises ValueError if a version is not above the lowest one."""
    versions = dict(pin.split("==") for pin in pins)
    for name, version in (other.split("==") for other in others):
        if name not in versions or Version(version) < Version(versions[name]):
            raise ValueError(f"--instead {name}=={version}: it must be one of the packages above, and no lower version")
        versions[name] = version
    return [f"{name}=={version}" for name, version in versions.items()]


def main() -> int:
    """Make the environment, say what is in it, run the tests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extras", nargs="*", default=["test"], help="of pyproject.toml, to install as well")
    parser.add_argument("--instead", nargs="*", default=[], metavar="NAME==VERSION", help="versions to install instead")
    parser.add_argument("--dry", action="store_true", help="only say what would be installed")
    parser.add_argument("pytest", nargs="*", default=["-q", "-m", "not slow and not robot"], help="its arguments")
    options = parser.parse_args()
    pins = instead(lowest(options.extras), options.instead)
    print(f"Python {sys.version.split()[0]}:", *pins, sep="\n  ", flush=True)
    if options.dry:
        return 0
    with tempfile.TemporaryDirectory(prefix="apf-lowest-") as folder:
        Path(folder).chmod(0o755)  # some tests run as another user
        venv.create(folder, with_pip=True)
        python = Path(folder, "Scripts" if sys.platform == "win32" else "bin", "python")
        install = [python, "-m", "pip", "install", "--quiet"]
        subprocess.run([*install, *pins], check=True)
        subprocess.run([*install, "--no-deps", REPOSITORY], check=True)
        subprocess.run([python, "-m", "pip", "check"], check=True)
        return subprocess.run([python, "-m", "pytest", *options.pytest], cwd=REPOSITORY).returncode


if __name__ == "__main__":
    sys.exit(main())
