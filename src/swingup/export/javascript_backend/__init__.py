"""Policies in a browser: the script that the report's pages hold."""
