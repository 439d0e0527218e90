"""Templates of the sentences in reports: which tracker is best, how surely, what went wrong, what to do next."""

#: Which tracker is best in a run, by the kind of evidence.
ANSWERS = {
    "none is ranked": "no tracker is ranked",
    "no truth": "no truth, so {trackers} without a ranking",
    "alone": "{over}{best} has a {what} of {error}",
    "not judged": "{over}{best} has the smallest {what}, {error}; {why}",
    "best alike": "{over}{names} are best{here} ({what} {errors}; the same {within})",
    "equivalent": "{over}{best} has the smallest {what}, {error}; the same as {whom} {within}{here}",
    "not shown better": "{over}{best} has the smallest {what}, {error}; not shown better than {whom}{here}",
    "shown better": "{over}{best} is best{here}: {what} {error}, shown better than {whom}",
}
#: Whether the expectations are met.
EXPECTATIONS = {
    "none": "The scenario states no expectations",
    "one met": "The expectation of the scenario is met",
    "met": "All {stated} of the scenario are met",
    "not met": "{failed} of {stated} of the scenario failed, {undecided} undecided",
}
#: How sure the verdicts of a run are.
CERTAINTY = {
    "all pairs": "Better and worse: a difference beyond the margin, {margin}, is shown; same: shown to be within it; "
    "not shown: neither. The risk that any pair is called so wrongly is 5 % (Holm, {pairs}).",
    "best of many": "The risk is 5 % that any tracker as good as the best is called worse than {best}, which was "
    "chosen from the same data; the margin is {margin}.",
    "undrawn": "{scenes} scenes may all miss a kind of scene that makes up {share} of all scenes: an order would be "
    "reversed if two trackers differed there {factor} times as much as here, the other way round",
    "few decide": "With fewer than {until} scenes an error is called larger only where it is more than 1.5 times the "
    "other: vehicles hide others, and one scene of a hundred in which one is lost may decide",
    "ahead": "In {number} of {total} another tracker is ahead of {best} by more than the margin{which}.",
}
#: Remarks on trackers and on the meaning of their errors.
REMARKS = {
    "charged": "{name}: {share} of its squared {error} is the charge for missing estimates ({without} without it)",
    "not called better": "{name} is not called better than {others}: its errors are smaller only with that charge",
    "below": "{name} is below the {label}: it expects this motion, or uses more than its measurements",
    "matched": "Errors and NEES are of tracks within {reach:g} m of their object: a smaller cutoff makes them smaller",
    "others ignored": "tracks on no object are ignored (truth.reference.others), so no score counts false tracks",
    "reference": "A reference is told which object caused each detection; its false tracks are predictions of objects "
    "that are hidden or gone",
    "offline": "A smoother (marked offline) also uses the measurements after each instant, so it is no competitor",
    "elsewhere": "{names}: tracks made elsewhere, so offline: nothing shows that they use no later measurements",
    "not paired": "{name} is compared with no tracker, since its file has no fingerprint of the scans",
    "used again": "identities used again after their track had ended are scored as one track: {trackers}",
    "left out": "{name}: {rows} outside the time of the truth are left out; there is no track in {runs}, where every "
    "object counts as missed",
    "clock": "{name}: time stamps fit best with {shift} added, if there is also a shift along the path; to add it, "
    "give --time-offset {seconds} (time_offset_s)",
}
#: Whether the truth is consistent.
TRUTH = {
    "not audited": "The truth was not audited.",
    "repaired": "The truth{where} had faults, which were repaired before anything was scored.",
    "consistent": "The truth is consistent: velocity agrees with displacement, no position jumps.",
}
#: Next questions, shown beside the command that answers each.
NEXT = {
    "doctor": "Has {name} a fault?",
    "inspect": "Where are the errors largest?",
    "scenes": "Does it hold in other traffic?",
}
#: Which tracker is ahead in a comparison, and how surely.
COMPARED = {
    "best": "{best} has the {end}, {value}. Next is {following}: {word}.",
    "worse": "Worse: {listed}.",
    "nobody ahead": "No tracker is shown to be ahead over {over}: beside {than}, the {what} of {subject} is {change}.",
    "ahead of next": "{best} is ahead over {over}: the {what} of {other}, the next, is {change}.",
    "ahead of baseline": "{best} has the smallest errors over {over}: its {what} is {change} than that of {other}, the "
    "baseline.",
    "not known how sure": "It is not known how sure this is.",
    "not known who": "It is not known who is ahead over {over}: in some of them {best} or {other} has no score, or an "
    "error of 0.",
    "pooled": "In %, with the 95 % interval of each alone; {over}: geometric mean of the ratios in these scenarios",
    "words": "{over} is about these scenarios, not about others. Worse, better: shown to differ by more than the "
    "margin, at 5 % for all pairs of {family} together (Holm; the intervals are not corrected). Same: within the "
    "margin. Not shown: neither.",
    "shared scenes": "For its interval, scenarios with the same scenes count as fully correlated: {listed}.",
}
