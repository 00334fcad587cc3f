"""The demo body of the body tests."""

from tests.body.conftest import body_path, model

__all__ = ["body_path", "model"]
