"""What a face does: expressions as amounts of the named controls.

"*" stands for both sides. Amounts are those of a full but not extreme performance; `data_recipes.animation` scales
them, makes them uneven and lets a smaller rig leave out the controls that it lacks. What faces do together stands
together here: a smile lifts the cheeks and narrows the eyes, a cry opens the jaw and squares the lower lip.
"""

from data_recipes.antics import ANTICS
from data_recipes.feelings import FEELINGS

EXPRESSIONS = FEELINGS | ANTICS
