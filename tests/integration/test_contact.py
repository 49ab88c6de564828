"""`model=tgn_contact` through the command line: a run, its resume, and the domain that it is not for."""

from pathlib import Path

import pandas as pd
import pytest

from integration.command_line import TINY, call
from integration.test_resume import stop_after

pytestmark = pytest.mark.usefixtures("no_figures")
CONTACT = (*TINY, "model=tgn_contact")


def test_a_stopped_run_is_resumed_from_its_directory(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    call(*CONTACT, "hydra.run.dir=whole").must_work()
    stop_after(9, monkeypatch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
    assert call(*CONTACT, "hydra.run.dir=run").code == 130
    monkeypatch.undo()
    monkeypatch.chdir(here)
    call("resume=run").must_work()
    for name in ("plans", "regret", "accuracy"):
        pd.testing.assert_frame_equal(pd.read_parquet(f"run/{name}.parquet"), pd.read_parquet(f"whole/{name}.parquet"))


def test_another_domain_is_refused(here: Path) -> None:
    result = call(*CONTACT, "domain=packing", "hydra.run.dir=run")
    result.must_refuse("model is ContactTGN, which is for TowerDomain", "PackingDomain")
    assert not Path("run").exists()
