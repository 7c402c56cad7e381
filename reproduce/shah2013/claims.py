"""The claims of shah2013, each with the rule that decides it, and what goes beyond the paper.

One rule decides the canonical case and random ones.
"""

from reproduce.claims import Rule
from reproduce.compare import figures_of
from reproduce.shah2013.deciding import (
    ARRIVED,
    MUCH,
    NONE,
    ORDER,
    PRINTED,
    SAME,
    SUDDEN,
    arrival_figures,
    arrives,
    at_the_printed_time,
    below,
    costs_later,
    dependent_figures,
    lead_figures,
    nonsingular,
    pair,
    ratio,
    reactionless,
    reactionless_figures,
    smooth_figures,
    sudden,
    sudden_figures,
    tracked,
    tracked_figures,
)
from reproduce.shah2013.measures import SAMPLES
from reproduce.shah2013.methods import ACCELERATION

CLAIMS = (
    Rule(
        "independent",
        "III, eq. 7 to 9",
        "The degree of redundancy is five, so the four linear velocities of the end-effectors can be chosen "
        "independently; the angular ones follow from them.",
        "Method (a) finds a plan: the rows of the four velocities and of the reactionless constraint keep "
        "rank five all along the path, and the joints stay within their limits.",
        lambda record: (
            f"Least singular value of the five rows along the path of (a): {found['least_singular']:.3f}."
            if (found := figures_of(record, "zeta_zero"))
            else NONE
        ),
        lambda record: figures_of(record, "zeta_zero") is not None,
        "The count is over all drawn cases: paths through singularities are where it fails.",
    ),
    Rule(
        "arrival",
        "III, Fig. 2",
        "Both arms start from rest and intercept the grapple points with the desired linear velocities.",
        f"End-effectors of all of (a), (b), (c) that found a plan miss points by at most {ARRIVED:.0e} m and "
        f"velocities by at most {ARRIVED:.0e} m/s.",
        arrival_figures,
        arrives,
        "Angular velocities are not matched, as the paper chooses. The optimum of (c) starts with a jump of "
        "the joint rates; (c′) starts from rest.",
    ),
    Rule(
        "reactionless",
        "III and IV, Fig. 3(c), 4(c), 5(c)",
        "The angular velocity of the base is of the order 1e-9 rad/s, which ensures reactionless "
        "manipulation.",
        "Re-integrated between the plans' nodes, the base rate of all of (a), (b), (c) that found a plan "
        f"stays below {ORDER:.0e} rad/s.",
        reactionless_figures,
        reactionless,
        "Re-integrating a motion that was made from the constraint shows that it was put in and integrated "
        "accurately, not that a robot would rest. That is what the simulation with held torques on a "
        "floating base shows; (c) starts there with its jump of the rates.",
    ),
    Rule(
        "zero_not_optimal",
        "III",
        "Energy and power with ζ = 0 are not the optimal ones.",
        "Energy of (c) is below that of (a).",
        pair("energy", "J s", 1.0, "ocp", "zeta_zero"),
        below("ocp", ("zeta_zero",), 1.0 - 1e-6),
    ),
    Rule(
        "instant",
        "IV-A",
        "Local optimisation minimises the instantaneous energy at each time.",
        "The joint rates of (b) are orthogonal to the free direction in the metric of I_m: cosine below "
        "1e-5.",
        lambda record: (
            f"Largest cosine: (b) {found['gradient']:.0e}"
            + (f", (a) {other['gradient']:.2f}." if (other := figures_of(record, "zeta_zero")) else ".")
            if (found := figures_of(record, "local"))
            else NONE
        ),
        lambda record: found["gradient"] < 1e-5 if (found := figures_of(record, "local")) else None,
        "True by construction: (b) is solved in closed form.",
    ),
    Rule(
        "local_energy",
        "IV-A, Fig. 4(d)",
        "Local optimisation needs more energy than ζ = 0.",
        "Energy of (b) is above that of (a).",
        pair("energy", "J s", 1.0, "local", "zeta_zero"),
        lambda record: None if (r := ratio(record, "local", ("zeta_zero",))) is None else r > 1.0 + SAME,
        "A property of the case, not of the method.",
    ),
    Rule(
        "local_power",
        "IV-A, Fig. 4(e)",
        "Local optimisation needs more power than ζ = 0.",
        "Peak power (sum of |torque × rate|) of (b) is above that of (a).",
        pair("peak_power", "mW", 1000.0, "local", "zeta_zero"),
        lambda record: (
            None if (r := ratio(record, "local", ("zeta_zero",), "peak_power")) is None else r > 1.0
        ),
    ),
    Rule(
        "jump",
        "IV-A, Fig. 4(a)",
        "At t = 18 s there is a sudden change in the optimal ζ.",
        f"ζ of (b) changes at its fastest at least {SUDDEN:g} times as fast as on average, and does so in "
        "the last quarter of the motion.",
        sudden_figures,
        sudden,
    ),
    Rule(
        "jump_time",
        "IV-A, Fig. 4(b)",
        "The change at t = 18 s is a significant change of the dependent velocity.",
        f"The dependent velocity of arm 1 under (b) changes fastest within {PRINTED[1]:g} s of "
        f"{PRINTED[0]:g} s. Asked of the canonical case alone.",
        dependent_figures,
        at_the_printed_time,
        "The paper's 18 s is arm 1's alone. Start and duration are lost; the canonical case stands in.",
    ),
    Rule(
        "jump_cost",
        "IV-A",
        "The sudden change makes the dependent velocities change, which needs the additional energy.",
        "Asked where (b) needs more than (a): 2 s before ζ changes fastest, (b) has not yet used more than "
        "(a).",
        lead_figures,
        costs_later,
    ),
    Rule(
        "not_total",
        "IV-A",
        "Local optimisation does not minimise the total energy.",
        "Energy of (c) is below that of (b).",
        pair("energy", "J s", 1.0, "ocp", "local"),
        below("ocp", ("local",), 1.0 - 1e-6),
    ),
    Rule(
        "ocp_energy",
        "IV-B, Fig. 5(d), V",
        "Optimal control needs much less energy than both others.",
        f"Energy of (c) is below {MUCH:g} times the lower one of (a) and (b).",
        pair("energy", "J s", 1.0, "ocp", "zeta_zero", "local"),
        below("ocp", ("zeta_zero", "local"), MUCH),
        "The change is against the better of the two.",
    ),
    Rule(
        "ocp_power",
        "IV-B, Fig. 5(e), V",
        "Optimal control needs much less power than both others.",
        f"Peak power of (c) is below {MUCH:g} times the lower one of (a) and (b).",
        pair("peak_power", "mW", 1000.0, "ocp", "zeta_zero", "local"),
        below("ocp", ("zeta_zero", "local"), MUCH, "peak_power"),
        "Power is not what is minimised.",
    ),
    Rule(
        "smooth",
        "IV-B, Fig. 5(a), 5(b)",
        "Optimal control gives a smooth transition of the dependent angular velocities.",
        "The dependent velocities of (c) never change as fast as those of (b) do.",
        smooth_figures,
        below("ocp", ("local",), 1.0, "jolt"),
    ),
    Rule(
        "collocation",
        "IV-B",
        "The polynomial satisfies the equations and the path constraints at the collocation points.",
        "Between the points too: path of (c) off by at most 1e-6 m, base rate at most 1e-8 rad/s.",
        lambda record: (
            f"Path off by {found['path']:.0e} m, base rate {found['base_rate']:.0e} rad/s, at {SAMPLES} "
            "times."
            if (found := figures_of(record, "ocp"))
            else NONE
        ),
        lambda record: (
            found["path"] <= 1e-6 and found["base_rate"] <= 1e-8
            if (found := figures_of(record, "ocp"))
            else None
        ),
        "After collocation our plans are integrated again along the paths, so that they hold in between.",
    ),
    Rule(
        "global",
        "IV-B",
        "Optimal control provides global optimisation.",
        "Not counted: a local method from several starts gives no bound from below.",
        lambda record: "Several starts, the motions of (a) and (b) among them; the best is taken.",
    ),
    Rule(
        "minimum",
        "V",
        "The method ensures reactionless manipulation with minimum energy consumption.",
        "No reactionless motion between the same ends with less energy is known: (d) does not go below (c).",
        pair("energy", "J s", 1.0, "free", "ocp"),
        lambda record: None if (r := ratio(record, "free", ("ocp",))) is None else r >= 1.0 - SAME,
        "Minimum holds along the given end-effector paths; the paths themselves are not optimal.",
    ),
)

BEYOND = (
    Rule(
        "never_worse",
        "(c) against (a), (b)",
        "From several starts, optimal control is never worse than either of the others.",
        "Cases in which all of (a), (b), (c) found a plan: energy of (c) is at most the lower one of the "
        "others.",
        pair("energy", "J s", 1.0, "ocp", "zeta_zero", "local"),
        below("ocp", ("zeta_zero", "local"), 1.0 + SAME),
    ),
    Rule(
        "free",
        "(d) against (c)",
        "With free paths the same capture costs less.",
        "Energy of (d) is at most that of (c); where (c) found a plan and (d) none, it counts as not so.",
        pair("energy", "J s", 1.0, "free", "ocp"),
        lambda record: (
            None
            if not figures_of(record, "ocp")
            else (r := ratio(record, "free", ("ocp",))) is not None and r <= 1.0 + SAME
        ),
        "Method (d) starts from rest and keeps the limits of the drives, which (c) does not.",
    ),
    Rule(
        "reaches",
        "(d)",
        "Free paths go where the polynomial ones do not.",
        "Asked where one of (a), (b), (c) found no plan: (d) finds one.",
        lambda record: (
            "All of (a), (b), (c) found a plan."
            if nonsingular(record)
            else "A plan."
            if figures_of(record, "free")
            else record["methods"]["free"]["reason"]
        ),
        lambda record: None if nonsingular(record) else figures_of(record, "free") is not None,
        "Where it finds none, the reasons are under Random cases.",
    ),
    Rule(
        "rest",
        "(c′) against (c)",
        f"Starting from rest, with accelerations up to {ACCELERATION} rad/s², costs next to nothing.",
        "Energy of (c′) is at most 1.001 times that of (c).",
        pair("energy", "J s", 1.0, "ocp_rest", "ocp"),
        below("ocp_rest", ("ocp",), 1.001),
    ),
    Rule(
        "torque",
        "simulated",
        "Tracked at torque level on a floating base, plans that start from rest hardly turn the satellite.",
        "Largest base rate at the suite's step: at most 1e-6 rad/s, for those of (a), (b), (c′), (d) that "
        "found a plan.",
        tracked_figures,
        tracked,
    ),
)
