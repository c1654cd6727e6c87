"""Published benchmarks for robots and people: COMTEST and DYSTURBANCE.

::

    import surefoot as sf

    found = sf.bench.comtest("walker", quick=True)
    print(found.table())
"""

from surefoot.bench.comtest_bench import Comtest, comtest
from surefoot.bench.dysturbance_bench import Dysturbance, dysturbance

__all__ = ["Comtest", "Dysturbance", "comtest", "dysturbance"]
