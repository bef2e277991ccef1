"""How well an estimate predicts, and what a record can say."""

from rotorid.validation.information import Information, information, information_of
from rotorid.validation.prediction import predict

__all__ = ["Information", "information", "information_of", "predict"]
