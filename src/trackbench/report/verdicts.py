"""Templates of the sentences in reports: which tracker is best, how surely, what went wrong, what to do next."""

#: Which tracker is best in a run, by the kind of evidence.
ANSWERS = {
    "none is ranked": "no tracker is ranked",
    "no truth": "no truth, so {trackers} without a ranking",
    "alone": "{over}{best} has a {what} of {error}",
    "not judged": "{over}{best} has the smallest {what}, {error}; {why}",
    "best alike": "{over}{names} are best{here} ({what} {errors}; no difference that matters, {within})",
    "equivalent": "{over}{best} has the smallest {what}, {error}; no difference that matters, {within}, to {whom}"
    "{here}",
    "not shown better": "{over}{best} has the smallest {what}, {error}; not shown better than {whom}{here}",
    "shown better": "{over}{best} is best{here}: {what} {error}, shown better than {whom}",
}
#: Whether the expectations are met.
EXPECTATIONS = {
    "none": "No expectations stated",
    "one met": "The expectation is met",
    "met": "All {stated} met",
    "not met": "{failed} of {stated} failed, {undecided} undecided",
}
#: How sure the verdicts of a run are.
CERTAINTY = {
    "all pairs": "Better and worse: shown by over the margin, {margin}; equivalent: within it. The risk that any is "
    "called so wrongly is 5 % (Holm, {pairs}).",
    "best of many": "The risk is 5 % that any tracker as good as the best is called worse than {best}, which was "
    "chosen from the same data; the margin is {margin}.",
    "undrawn": "{scenes} scenes may leave out a kind of scene that makes up {share} of all: an order would turn if two "
    "trackers differed there by {factor} times as much as in these scenes, in the other direction",
    "few decide": "Vehicles hide others, and one scene of a hundred in which one is lost may decide: with fewer than "
    "{until} scenes an error is shown to be larger only where it is more than 1.5 times the other",
    "ahead": "In {number} of {total} another tracker is ahead of {best} by more than the margin{which}.",
}
#: Remarks on trackers and on the meaning of their errors.
REMARKS = {
    "charged": "{name}: {share} of its squared {error} is charged for missing estimates ({without} without)",
    "not called better": "{name} is not called better than {others}: its errors are smaller only with what is charged",
    "below": "{name} is below the {label}: it expects this motion, or knows more than its measurements say",
    "matched": "Errors and NEES are of tracks within {reach:g} m of their object: a smaller cutoff makes them smaller",
    "others ignored": "tracks on no object are ignored (truth.reference.others): no score tells false tracks",
    "reference": "A reference knows which detection is whose; its false tracks: predicted further while their object "
    "is hidden or gone",
    "offline": "A smoother, marked offline, knows the measurements after each instant too: it is no competitor",
    "elsewhere": "{names}: offline, made elsewhere: nothing shows that they did not see the future",
    "not paired": "{name}: no fingerprint says of which scans, so compared with no tracker",
    "used again": "identities used again after their track had ended are scored as one track: {trackers}",
    "left out": "{name}: {rows} outside the time of the truth, left out; no track in {runs}, all missed there",
    "clock": "{name}: time stamps fit best with {shift} added, beside a shift along the path; --time-offset or "
    "time_offset_s adds it, {seconds} s",
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
    "scenes": "The same in other traffic?",
}
#: Which tracker is ahead in a comparison, and how surely.
COMPARED = {
    "best": "{best} has the {end}, {value}. Next is {following}: {word}.",
    "worse": "Shown to be worse: {listed}.",
    "ahead of next": "{best} is ahead{by} over {over}: the {what} of {other}, the next, is {change}.",
    "ahead of baseline": "{best} is ahead{by} over {over}: its {what} is {change} than that of {other}, the baseline.",
    "ahead by rank": "{best} is ahead over {over}: mean rank {rank}, {other} of {second}, the next.",
    "too few": "Of other scenarios nothing is shown: with {trackers} that takes {wanted} sets of scenes, here are "
    "{sets}.",
    "lead": "In other scenarios like these its mean rank is {shown} to be the best (sign-flip test of the ranks over "
    "the sets of scenes, p = {p_value}).",
    "pooled": "In %, with the 95 % interval of each alone; {over}: geometric mean of the ratios in these scenarios",
    "words": "{over} speaks of these scenarios, not of others. Worse, better: by over the margin, at 5 % for all pairs "
    "of {family} together (Holm), for which the intervals are not corrected; same: within the margin; not shown: "
    "neither.",
}
