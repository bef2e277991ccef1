# The names of this part and where they live; read by type checkers, and when it is imported.
from .batch import Batch as Batch
from .knowledge import Constraint as Constraint
from .least_squares import LeastSquares as LeastSquares
from .likelihood.bound import Plan as Plan
from .likelihood.bound import predict_accuracy as predict_accuracy
from .maximum_likelihood import MaximumLikelihood as MaximumLikelihood
from .methods import Estimator as Estimator
from .methods import by_name as by_name
from .modes import Mode as Mode
from .sequential import Sequential as Sequential
