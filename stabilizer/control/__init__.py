"""Reference, tasks, first QP (TSID), wrench law, second QP (DIK)."""
