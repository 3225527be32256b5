"""AR-EAPO: average-reward entropy advantage policy optimisation, and its relatives PPO, EAPO and APO."""
