"""What a program or a notebook needs, each with the settings and the results of the command of the same name.

    import apf

    run = apf.run(["+experiment=smoke", "tracker=none"], "runs/first")     # python -m apf.main; again: goes on
    run = apf.load_run("runs/first")
    run.tables["regret"]                                                   # a pandas frame

    found = apf.plan("mine.csv", "overhang", run=run, length=5, top=3)     # python -m apf.plan
    found.table, found.choices[0].chance
    apf.predict(found.plans, run)                                          # python -m apf.predict
    apf.label(found.plans, world="noisy")                                  # python -m apf.label

Objects and plans are files or pandas frames in the columns of such files; plans may also be a batch of the domain's own
class. `overrides` are what a command line has: any key of the command's config. A mistake raises
`apf.errors.InputError`, whose message is the line that the command prints.
"""

from apf.api.questions import label, plan, predict
from apf.api.runs import Run, load_run, run
from apf.commands.plan import Found

__all__ = ["Found", "Run", "label", "load_run", "plan", "predict", "run"]
