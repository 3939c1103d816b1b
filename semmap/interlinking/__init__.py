"""Which records of two data sets describe one resource: Fan's method (Tosello et al., III-D)."""
