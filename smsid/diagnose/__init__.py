"""Diagnosis: what the simulation gets wrong, the cause by name, the extended model and what it gains."""
