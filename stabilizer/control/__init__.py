"""The whole-body controller: tasks, first QP (TSID), wrench law, second QP (DIK)."""
