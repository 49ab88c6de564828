"""python -m apf.label: label every prefix of somebody's own plans. See `apf.commands.label`."""

from apf.commands.label import main

if __name__ == "__main__":
    main()
