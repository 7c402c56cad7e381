"""Text of the page of shyam2020."""

from agents.policies.single_arm.promp_feedback import POSITION_NOISE, RATE_NOISE
from reproduce.page.text import PageText
from reproduce.shyam2020.page import thresholds
from reproduce.shyam2020.sampling import SHOWN
from reproduce.shyam2020.steps import LOCKED_STARTS, SPHERE_RADIUS

CONSTANTS = {name: value for name, value in vars(thresholds).items() if name.isupper()}
TEXT = PageText.of(
    "shyam2020",
    {
        "SPHERE_RADIUS": SPHERE_RADIUS,
        "LOCKED_STARTS": LOCKED_STARTS,
        "POSITION_NOISE": POSITION_NOISE,
        "RATE_NOISE": RATE_NOISE,
        "SHOWN": SHOWN,
        **CONSTANTS,
    },
)
