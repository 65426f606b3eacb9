"""Where the command `profilecal` begins: with a sentence if packages are missing."""

import sys
from importlib.util import find_spec

PACKAGES = ("click", "matplotlib", "pandas", "tqdm")


def main() -> None:
    """Run the command line; without its packages, say how to install them.

    That ends with status 2, as wrong input does; Ctrl-C before any command has begun
    with 130.
    """
    try:
        missing = [name for name in PACKAGES if find_spec(name) is None]
        if missing:
            print(
                f"profilecal: the command needs {', '.join(missing)}: "
                'pip install "profilecal[tool]"',
                file=sys.stderr,
            )
            raise SystemExit(2)
        from profilecal_tool import cli

        cli.main()
    except KeyboardInterrupt:
        print("\nInterrupted. Nothing was written.", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
