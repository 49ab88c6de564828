"""Configs: the schema of a run, how its parts are made and checked, what is said of a mistake."""
