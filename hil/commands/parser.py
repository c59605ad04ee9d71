"""The one look of every subcommand's options."""

import argparse


def new_parser(name: str, description: str | None, examples: str) -> argparse.ArgumentParser:
    """A parser for `uuv-hil NAME` whose --help ends with `examples` as they stand."""
    return argparse.ArgumentParser(
        prog=f"uuv-hil {name}",
        description=description,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
