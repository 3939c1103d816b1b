"""Open-RMF buildings."""

from semmap.ingest.rmf.building import read_rmf

__all__ = ["read_rmf"]
