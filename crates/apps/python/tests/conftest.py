"""A small scene for all tests."""

from typing import Any

import pytest

JOB: dict[str, Any] = {
    "scene": "none",
    "film": {"width": 24, "height": 16},
    "budget": {"spp": 8},
    "camera": {"look_at": [0, 0, 0], "position": [0, 0.3, 0.4]},
    "environment": {"radiance": 1},
    "object": [
        {"name": "ball", "kind": "sphere", "diameter": "100mm"},
        {"name": "floor", "kind": "plane", "size": ["500mm", "500mm"], "translate": [0, "-60mm", 0]},
    ],
}


@pytest.fixture
def job() -> dict[str, Any]:
    return {key: value.copy() if hasattr(value, "copy") else value for key, value in JOB.items()}
