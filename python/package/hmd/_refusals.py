"""Whatever an argument makes numpy or the interpreter say, as the one error of the package for it."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from ._hmd import Error, UsageError

P = ParamSpec("P")
R = TypeVar("R")


def refusing(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with a `UsageError` in the place of errors about the kind and range of its arguments."""

    @wraps(function)
    def refused(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except Error:
            raise
        except (TypeError, ValueError, OverflowError, AttributeError, IndexError) as error:
            raise UsageError(f"{function.__name__}: expected other arguments: {error}") from error

    return refused
