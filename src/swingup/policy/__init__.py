"""A policy: its file, what the file may hold, and what runs it.

``file`` reads and writes files, ``pendulum`` is what one holds for a robot, ``plant_facts`` is what it knows of the
plant, ``shipped`` names the policies of this package, and ``contract`` says what a back end does; each part around
the network has a folder with its settings and equations. They need NumPy alone. A package ``*_backend`` runs a
policy, or writes a program that does.
"""
