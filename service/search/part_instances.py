"""How often one of two shapes has the other as a piece, in numbers and in words."""

from typing import Literal

from pydantic import BaseModel, Field, computed_field


class PartInstances(BaseModel):
    """How many pieces of one shape, the whole, are copies of the other, the part, in its size."""

    whole: Literal["first", "second"] = Field(description="The shape that has the other as a piece.")
    count: int = Field(description="The number of its pieces that are rigid copies of the part.")
    mirrored: int = Field(description="The number of its pieces that are copies of the part's mirror image.")

    @computed_field(  # type: ignore[prop-decorator]
        description="The same in words, said of the second shape."
    )
    @property
    def text(self) -> str:
        """The numbers in words: "Contains it 6 times", "Part of it, once"."""
        contains = self.whole == "second"
        if not self.count:
            words = "Contains its mirror image" if contains else "Mirror image of a part of it,"
            return f"{words} {_times(self.mirrored)}"
        words = f"Contains it {_times(self.count)}" if contains else f"Part of it, {_times(self.count)}"
        return f"{words}, its mirror image {_times(self.mirrored)}" if self.mirrored else words


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
