# The public names and where they live; read by type checkers, and when rotorid is imported.
from .errors import InputError as InputError
from .errors import ModelError as ModelError
from .errors import ReadError as ReadError
from .estimate import Alternative as Alternative
from .estimate import EquationMisfit as EquationMisfit
from .estimate import Estimate as Estimate
from .estimate import LineMisfit as LineMisfit
from .estimate import Misfit as Misfit
from .estimate import Prediction as Prediction
from .estimate import Provenance as Provenance
from .estimate import Suspect as Suspect
from .estimate import Value as Value
from .estimate import load_estimate as load_estimate
from .estimators import Batch as Batch
from .estimators import Constraint as Constraint
from .estimators import Estimator as Estimator
from .estimators import LeastSquares as LeastSquares
from .estimators import MaximumLikelihood as MaximumLikelihood
from .estimators import Plan as Plan
from .estimators import Sequential as Sequential
from .estimators import predict_accuracy as predict_accuracy
from .experiment import Experiment as Experiment
from .experiment import load_experiment as load_experiment
from .filtered import FilteredRecord as FilteredRecord
from .filtered import filtered as filtered
from .identify import identify as identify
from .io import read_record as read_record
from .lines import Lines as Lines
from .models import Model as Model
from .models import load_model as load_model
from .models import parse_model as parse_model
from .models import shipped_models as shipped_models
from .predict import predict as predict
from .record import Channel as Channel
from .record import Check as Check
from .record import Drive as Drive
from .record import PeriodicRecord as PeriodicRecord
from .record import Record as Record
from .results.export import export as export
from .rig import simulate as simulate
from .rig import steady_state as steady_state
from .signals import average as average
from .spectra import spectra as spectra

__version__: str
__all__: list[str]
