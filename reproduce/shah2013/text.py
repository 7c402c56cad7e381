"""Text of the page of shah2013."""

from reproduce.page.text import PageText
from reproduce.shah2013 import thresholds
from reproduce.shah2013.measures import SAMPLES
from reproduce.shah2013.methods import ACCELERATION

CONSTANTS = {name: value for name, value in vars(thresholds).items() if name.isupper()}
TEXT = PageText.of("shah2013", {"SAMPLES": SAMPLES, "ACCELERATION": ACCELERATION, **CONSTANTS})
