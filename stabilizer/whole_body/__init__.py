"""The whole-body controller: one tick of both QPs and the wrench law, and its sway."""
