"""The commands that answer questions about somebody's own objects and plans: what each is given, and what it does.

`python -m apf.plan`, `apf.predict` and `apf.label` start them. These three files of the package are run, and
imported by nobody: after an import, `apf.plan` would be the file instead of the function of that name (`apf.api`).
"""
