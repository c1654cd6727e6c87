"""Benchmarks that others measure robots and people by.

::

    import surefoot as sf

    found = sf.bench.comtest("walker", quick=True)
    print(found.table())
"""

from surefoot.bench.comtest_bench import Comtest, comtest

__all__ = ["Comtest", "comtest"]
