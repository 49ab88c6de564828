"""MLflow: a run in local files, or at a server."""

import os
import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from apf.config.values import flatten
from apf.settings import settings
from apf.tracking.base import Metrics, RunFiles, RunInfo
from apf.tracking.mirror import Mirror

IDENTIFIER = "apf.id"
"""Tag by which a resumed run finds itself."""
PARAMS, LONGEST = 100, 6000
"""Of MLflow: parameters in one call, and characters of a value."""
Point = tuple[str, int]
"""A metric and a number of labelled plans."""


@dataclass
class Opened:
    """MLflow's client, the id of the run, and the points that the run had before."""

    client: Any
    run: str
    there: set[Point]


@settings
class MlflowTracker(Mirror):
    """One MLflow run for each run: metrics over labelled plans, the config as parameters, tables and figures.

    A resumed run goes on with its MLflow run, and logs only what is missing there.
    """

    uri: str = "mlruns"
    """A folder, or what else MLflow takes as a tracking URI."""
    experiment: str = "apf"

    title = "MLflow"
    extra = "mlflow"

    def open_run(self, run: RunInfo) -> Opened:
        """The run at MLflow, new or found again."""
        if "://" not in self.uri or self.uri.startswith("file:"):
            os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")  # MLflow asks for it since 3.7
        from mlflow import MlflowClient
        from mlflow.entities import Param

        uri = self.uri if "://" in self.uri or self.uri.startswith("file:") else Path(self.uri).absolute().as_uri()
        client = MlflowClient(tracking_uri=uri)
        experiment = client.get_experiment_by_name(self.experiment)
        number = experiment.experiment_id if experiment else client.create_experiment(self.experiment)
        found = client.search_runs([number], f"tags.`{IDENTIFIER}` = '{run.id}'")
        if found:
            identifier = found[0].info.run_id
            client.update_run(identifier, status="RUNNING")
            histories = (client.get_metric_history(identifier, name) for name in found[0].data.metrics)
            return Opened(client, identifier, {(point.key, point.step) for points in histories for point in points})
        words = {name: str(value) for name, value in run.choices.items()}
        tags = {IDENTIFIER: run.id, "sweep": run.group or "", **words}
        identifier = client.create_run(number, run_name=run.name, tags=tags).info.run_id
        params = iter(Param(key, str(value)[:LONGEST]) for key, value in flatten({**run.about, **run.config}).items())
        while batch := [*islice(params, PARAMS)]:
            client.log_batch(identifier, params=batch)
        return Opened(client, identifier, set())

    def write(self, opened: Opened, metrics: Metrics) -> None:
        """Points that are not there yet."""
        from mlflow.entities import Metric

        missing = {name: value for name, value in metrics.values.items() if (name, metrics.plans) not in opened.there}
        now = int(time.time() * 1000)
        points = [Metric(name, float(value), now, metrics.plans) for name, value in missing.items()]
        if points:
            opened.client.log_batch(opened.run, metrics=points)

    def write_files(self, opened: Opened, files: RunFiles) -> None:
        """Tables, weights and pictures as artifacts."""
        for path in (*files.tables, *files.weights):
            opened.client.log_artifact(opened.run, str(path))
        for path in files.pictures().values():
            opened.client.log_artifact(opened.run, str(path), "pictures")

    def close(self, opened: Opened, failed: bool) -> None:
        """How the run ended."""
        opened.client.set_terminated(opened.run, "FAILED" if failed else "FINISHED")
