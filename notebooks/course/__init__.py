"""Code of the notebooks: a folder per chapter (panel, figures, exercises), and shared modules.

Panels: `panel` has the base class of all panels, and `controls` makes controls from declared settings. `redraws`
decides when a panel draws, `opening` which sequence it shows, and `progress` runs long work on a thread.

Data: `frames` has frames and their matches, `kept_runs` finished paths, and `memory` keeps both. `simulation` and
`perturbed_path` make drives without images and paths with known errors. `candidates` takes the steps of solution
selection one by one, and `rotation_errors` compares their results with the truth.

Pictures: `drawing` has their style, and `colours` their colours. `drawn_matches` draws matches into photos, `by_depth`
is a chart of two chapters, `view3d` shows shapes that the mouse rotates, and `raster` turns figures into pixels.
`measured_results` reads the tables beside the notebooks, and `intervals` tests means over seeds.

Exercises: `checker` checks answers, with the comparisons of `results`; `stored_answers` saves those that passed, and
`own_functions` runs them on frames beside the library's. `answer_log` writes down what the checks said, and `tasks`,
`submissions`, `grading`, `supervised`, `marks` and `hand_in` are for handing in and marking.

Pages: `pages` writes the executed notebooks as HTML, and `minutes` counts how long a chapter takes. `notebook_folder`
says where the notebooks are, and `kernel` which Python to choose if that of the kernel lacks the kit.
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
from .frames import scene_truth as scene_truth
from .frames import stereo as stereo
from .own_functions import apart as apart
from .own_functions import chosen_apart as chosen_apart
from .own_functions import own_or_library as own_or_library
