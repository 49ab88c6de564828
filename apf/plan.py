"""python -m apf.plan: the best plans found for somebody's own objects. See `apf.commands.plan`."""

from apf.commands.plan import main

if __name__ == "__main__":
    main()
