"""A policy: its file, what the file may hold, and what runs it.

``file`` reads and writes files, ``pendulum`` is what one holds for a robot, ``settings`` are those of the parts
around it, ``shipped`` names the policies of this package, and ``contract`` says what a back end does. They
need NumPy alone. A package ``*_backend`` runs a policy, or writes a program that does.
"""
