"""What the commands do: what each is given, and what comes of it.

`python -m apf.main`, `apf.plan`, `apf.predict`, `apf.label` and `apf.relabel` start them. These files of the package
import this room when there is work, so that their help is there at once. They are run, and imported by nobody: after an
import, `apf.plan` would be the file instead of the function of that name (`apf.api`).
"""
