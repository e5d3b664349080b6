from .insertion import ElasticInsertion as ElasticInsertion
from .model import ElasticModel as ElasticModel
from .model import ElasticTissueState as ElasticTissueState
