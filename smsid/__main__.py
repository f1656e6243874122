"""``python -m smsid``: the command line."""

from smsid.cli.app import main

if __name__ == "__main__":
    main()
