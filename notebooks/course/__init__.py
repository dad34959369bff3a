"""Code of the notebooks: a folder per chapter (panel, figures, exercises), and shared modules.

`panel` has the base class of all panels, and `controls` makes controls from declared settings. `frames` has
frames and their matches. `drawing` has the style of the pictures. `progress` has threads for work of more
than a second. `checker` checks answers to exercises, `stored_answers` saves answers that passed, and
`own_functions` runs them on frames beside the library's. `records` writes down what the checks said, and `tasks`,
`submissions`, `grading`, `marks` and `hand_in` are for handing in and marking.
"""

from .kernel import require_kit

require_kit()  # before the imports that need it

from .checker import strict as strict
from .drawing import figure as figure
from .drawing import finish as finish
from .drawing import show as show
from .drawing import show_source as show_source
from .frames import frame_matches as frame_matches
from .frames import frame_points as frame_points
from .frames import has_data as has_data
from .frames import load as load
from .frames import real_pair as real_pair
from .frames import stereo as stereo
from .frames import truth as truth
from .own_functions import apart as apart
from .own_functions import chosen_apart as chosen_apart
from .own_functions import own_or_library as own_or_library
