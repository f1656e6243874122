"""One estimator: a description, recordings and unknowns with priors, and what the likelihood says of them."""
