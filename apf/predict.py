"""python -m apf.predict: how likely is each prefix of somebody's own plans to succeed?. See `apf.commands.predict`."""

from apf.commands.predict import main

if __name__ == "__main__":
    main()
