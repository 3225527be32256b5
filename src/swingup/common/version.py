"""The version; pyproject.toml and CITATION.cff name the same, which a test holds."""

__version__ = "0.1.0"
