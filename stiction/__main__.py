"""Entry point of the command `stiction` and of ``python -m stiction``.

Child processes import this module. Therefore all imports that take long are inside the function.
"""

import sys


def main() -> None:
    """Run the command line."""
    import stiction.silent_interrupt  # noqa: F401 - sets the handler
    from stiction.child_processes import child_context

    if sys.argv[1:2] == ["run"] and "--help" not in sys.argv:
        # The imports of the child process take longer than those of this one, and are made meanwhile.
        child_context()
    from stiction.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
