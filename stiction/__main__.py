"""The command `stiction`, as ``python -m stiction`` too. Children import this module, which therefore imports nothing."""


def main() -> None:
    from stiction.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
