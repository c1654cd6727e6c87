"""All checks of the doctor, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from surefoot.cli.doctor.diagnosis import Diagnosis, Severity


def examine() -> Iterator[Diagnosis]:
    """Look at everything; a check that cannot be done is a finding of its own."""
    yield from _try("packages", _packages)
    # What follows needs packages; without one of them it says so.
    for name, check in (
        ("linear algebra", _computing),
        ("bus, disk, pictures", _surroundings),
    ):
        yield from _try(name, check)


def _packages() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor.packages import check_extras, check_packages, check_python

    yield check_python()
    yield from check_packages()
    yield from check_extras()


def _computing() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor import computing

    yield computing.check_msgpack()
    yield computing.check_processors()
    yield computing.check_clock()
    yield computing.check_priority()
    yield computing.check_blas()


def _surroundings() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor import surroundings

    yield surroundings.check_bus()
    yield surroundings.check_port()
    yield from surroundings.check_disk()
    yield surroundings.check_pictures()
    yield surroundings.check_browser()


def _try(name: str, check: Callable[[], Iterator[Diagnosis]]) -> Iterator[Diagnosis]:
    from surefoot.cli.console import import_advice

    try:
        yield from check()
    except ImportError as error:
        yield Diagnosis(
            name=name,
            verdict=Severity.FAIL,
            got=str(error),
            advice=import_advice(error),
        )
