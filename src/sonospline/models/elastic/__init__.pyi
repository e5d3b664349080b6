from .insertion import ElasticInsertion as ElasticInsertion
from .model import ElasticModel as ElasticModel
from .tissue_state import ElasticTissueState as ElasticTissueState
