"""Maximum likelihood: refinement of the linear estimate to the Cramer-Rao bound, and that bound itself."""
