"""The parameters of the setting `default` in earlier versions, by which stored archives are embedded."""

from core.parameters import DEFAULT

BEFORE_SMALLER_SURFACES = DEFAULT.with_values(
    decimate_above=30_000, decimate_to=5_000, decimate_pieces_above=0, refine_simplified=0
)
BEFORE_ORIENTATION = BEFORE_SMALLER_SURFACES.with_values(orientation=False)
BEFORE_VIEWS = BEFORE_ORIENTATION.with_values(views=False)
