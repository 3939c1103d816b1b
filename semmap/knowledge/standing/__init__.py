"""Standing queries: what begins and ceases to be an answer as the map changes.

`subscriptions` is what programs use; `queries` evaluates what a change concerns.
"""
