"""The paper's adaptive filter, eq. (5)-(12), online and for fleets, and least squares beside it."""
