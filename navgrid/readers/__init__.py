"""Database access of `navgrid`: no other module here has SQL."""
