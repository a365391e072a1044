"""`python -m stand`: the same as the command `stand`."""

from stand.cli import main

if __name__ == "__main__":
    main()
