"""Evidence of rows: priors, linear model, likelihood, Bayes factors, posterior odds."""
