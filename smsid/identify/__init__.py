"""Identification: estimators, from arrays to numbers with intervals."""
