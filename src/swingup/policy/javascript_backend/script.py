"""The script that runs a policy in a browser."""

from importlib import resources


def policy_script() -> str:
    """JavaScript that defines ``swingup.makePolicy(spec, driven)``, for a classic script element."""
    return (resources.files(__package__) / "policy.js").read_text(encoding="utf-8")
