"""The judge: closed-loop simulation, the criteria and scores, the rules as data, the published results."""
