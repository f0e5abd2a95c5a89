"""Numbers on the command line of both programs."""

import argparse


def seed(text: str) -> int:
    """A seed of 64 bits."""
    return _within(text, 2**64 - 1)


def workers(text: str) -> int:
    """A number of local workers."""
    return _within(text, 1024)


def _within(text: str, most: int) -> int:
    if not (text.isascii() and text.isdigit() and int(text) <= most):
        raise argparse.ArgumentTypeError(f"expected a whole number from 0 to {most}, found {text!r}")
    return int(text)
