"""Entry of the ``surefoot`` command and of ``python -m surefoot.cli``."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress
from types import FrameType

from surefoot.errors import ERROR_PREFIX, ExitCode, exit_code_of, foreseen
from surefoot.schemas.reasons import SIGNALS

# 34 x 34 algebra is slower with threads, and its slowest ticks are much slower. The
# variables are read when numpy and its libraries load, so this must come first.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
if not os.environ.get("COLUMNS", "1").strip("0"):
    del os.environ["COLUMNS"]  # zero is no width: rich would print empty tables


def main() -> None:
    """Run the command line; exits with a code of :class:`ExitCode`."""
    interruption = _Interruption()
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file name may not fit its encoding
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        from surefoot.cli.app import app

        app(prog_name="surefoot")
    except (Exception, KeyboardInterrupt) as error:
        # The one place where errors become exit codes. An unexpected error keeps its
        # traceback and exits with code 1.
        told = foreseen(error)
        code = exit_code_of(told)
        if interruption.has_come:
            # A library that was loading may have turned the signal into any error.
            code = ExitCode.INTERRUPTED
        if code is None:
            raise
        if not interruption.has_come:
            from surefoot.cli.console import print_error

            print_error(told)
        sys.exit(code)
    finally:  # typer turns a KeyboardInterrupt into an exit, without a message
        interruption.tell()


class _Interruption:
    """Ends a command on a signal, such that everything is closed on the way out.

    Attributes:
        has_come: whether a signal has arrived.
        by: the signal, in words for a message; empty when none has arrived.
    """

    def __init__(self) -> None:
        """Install the handlers; a running node replaces them by its own meanwhile."""
        self.has_come = False
        self.by = ""
        for number in SIGNALS:
            signal.signal(number, self._come)

    def tell(self) -> None:
        """Say which signal has ended the command, if one has.

        Uses no colours: the library for them may have been loading.
        """
        if self.has_come:
            # A signal that arrives while ``exec`` runs, as dataclasses use it, stays
            # pending in Python and would end it later; another ``exec`` clears it.
            exec("")
            with suppress(OSError):  # the terminal may be closed
                sys.stderr.write(f"{ERROR_PREFIX} interrupted{self.by}\n")
                sys.stderr.flush()

    def _come(self, signum: int, frame: FrameType | None) -> None:
        self.has_come = True
        self.by = f" by {signal.Signals(signum).name}"
        raise KeyboardInterrupt(signal.Signals(signum).name)


if __name__ == "__main__":
    main()
