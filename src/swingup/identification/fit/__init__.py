"""Parameters from recordings: prediction, regression, fit, intervals and scores."""
