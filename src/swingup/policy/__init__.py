"""A policy: its file, what the file may hold, and what runs it.

NumPy alone is needed here. The packages ``*_backend`` run a policy, or write a program that does.
"""
