"""The command `stiction`, as ``python -m stiction`` too. Children import this module, which therefore imports next to nothing."""

import sys


def main() -> None:
    import stiction.silent_interrupt  # noqa: F401
    from stiction.child_processes import child_context

    if sys.argv[1:2] == ["run"] and "--help" not in sys.argv:
        child_context()  # what the child imports takes longer than all that is imported here, and is imported beside it
    from stiction.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
