"""The topology in formats of other software: Nav2, Open-RMF, Graphviz, and as a picture."""
