"""Interlinking: which records of two data sets describe the same resource (Tosello et al., III-D).

The method is Fan's, which the paper cites: properties correspond by K-medoids over their
statistics, and a version space finds the link pattern from few labelled pairs. Modules named
`store` and `reader` use the database; all others take and return arrays and plain data.
"""
