"""Entry of the ``surefoot`` command and of ``python -m surefoot.cli``."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType

from surefoot.errors import ERROR_PREFIX, ExitCode, exit_code_of, foreseen
from surefoot.schemas.reasons import SIGNALS

# 34 x 34 algebra is slower with threads, and its tail far worse. Read when numpy
# and its libraries load, so it must stand before any of them.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
if not os.environ.get("COLUMNS", "1").strip("0"):
    del os.environ["COLUMNS"]  # no width is said; rich would show tables without one


def main() -> None:
    """Run the command line; the exit code is the one of :class:`ExitCode`."""
    interruption = _Interruption()
    try:
        from surefoot.cli.app import app

        app(prog_name="surefoot")
    except (Exception, KeyboardInterrupt) as error:
        # The one place where errors become exit codes; unforeseen ones go on as
        # they are, with their traceback and code 1.
        told = foreseen(error)
        code = exit_code_of(told)
        if interruption.has_come:
            # A library that is loading may make any error of it.
            code = ExitCode.INTERRUPTED
        if code is None:
            raise
        if code is not ExitCode.INTERRUPTED:
            from surefoot.cli.console import print_error

            print_error(told)
        sys.exit(code)
    finally:  # typer makes an exit of a KeyboardInterrupt, without a word
        interruption.tell()


class _Interruption:
    """Ends a command on a signal that asks for it; everything is closed on the way.

    Attributes:
        has_come: whether one of them did.
        by: which, for a message; empty when none did.
    """

    def __init__(self) -> None:
        """Begin to watch; a node that runs has handlers of its own meanwhile."""
        self.has_come = False
        self.by = ""
        for number in SIGNALS:
            signal.signal(number, self._come)

    def tell(self) -> None:
        """Say which signal has ended the command; nothing when none did.

        Plainly: what prints in colours may be what was being loaded.
        """
        if self.has_come:
            # One that came while a text was executed, as dataclasses do when they are
            # made, is kept in mind, and ends Python by the signal; this forgets it.
            exec("")
            with suppress(OSError):  # a terminal that has closed hears nothing
                sys.stderr.write(f"{ERROR_PREFIX} interrupted{self.by}\n")
                sys.stderr.flush()

    def _come(self, signum: int, frame: FrameType | None) -> None:
        self.has_come = True
        self.by = f" by {signal.Signals(signum).name}"
        raise KeyboardInterrupt(signal.Signals(signum).name)


if __name__ == "__main__":
    main()
