from .insertion import ElasticInsertion as ElasticInsertion
from .model import ElasticModel as ElasticModel
from .model import ElasticTissueState as ElasticTissueState
from .solver import ElasticSolver as ElasticSolver
from .state import ElasticState as ElasticState
from .state import NotConvergedError as NotConvergedError
