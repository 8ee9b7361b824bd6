"""`python -m hilscenario`: the same as `hilscenario`."""

from hilbridge.entry import start


def main() -> None:
    """Entry point."""
    start("hilscenario.cli")


if __name__ == "__main__":
    main()
