"""Client of the Afterimage service. Made of its OpenAPI document by script/make_python_client; do not edit.

    from afterimage_client import Client
    client = Client("http://127.0.0.1:8080", token="aft_…")
    client.create_report({"sequence": "bistro", "system": "engine", "values": {"psnr": 38.2}})

Every method is an endpoint. What is refused raises `Problem`. Busy services and broken connections are tried again; a
POST has an idempotency key, so that it is done once however often it is sent. It needs Python 3.10 or newer and no package.
"""

from __future__ import annotations

import hashlib
import http.client
import json
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from typing import TYPE_CHECKING, Any, BinaryIO, Dict, Iterator, List, Literal, Optional, TypedDict, Union, overload

if sys.version_info >= (3, 11):
    from typing import NotRequired
elif TYPE_CHECKING:  # Checkers know it of every Python, and nothing else reads it.
    from typing_extensions import NotRequired


class AdapterInfo(TypedDict):
    """The adapter a report was made on. Times compare only between equal ones."""

    #: `Vulkan`, …
    backend: str
    #: Driver's name.
    driver: str
    #: Driver's version.
    driver_version: str
    #: `Cpu`, `DiscreteGpu`, …
    kind: str
    #: Name as the driver gives it.
    name: str

class AdapterRequest(TypedDict):
    """An adapter's fingerprint."""

    #: `Vulkan`, `D3D12`, …
    backend: NotRequired[str]
    #: Driver's name.
    driver: NotRequired[str]
    #: Driver's version.
    driver_version: NotRequired[str]
    #: `DiscreteGpu`, …
    kind: NotRequired[str]
    #: Name as the driver gives it.
    name: NotRequired[str]

class Agreement(TypedDict):
    """Two images, or all that a pass writes."""

    #: Everything is finite, and within the bounds where there are any.
    agrees: bool
    #: The largest distance of a pixel that is finite on both sides.
    max: float
    #: On average over the pixels that are not beyond; of a pass that writes several images, the largest of them.
    mean: float
    #: Pixels beyond the largest distance allowed.
    n_beyond: int
    #: Pixels beyond it that count neither there nor in the mean, because 32-bit arithmetic does not determine them: the twin in f32 is itself far from the twin in f64.
    n_undetermined: int
    #: Pixels that are not finite on the GPU.
    non_finite_gpu: int
    #: Pixels that are not finite in the twin.
    non_finite_twin: int
    #: Of all pixels.
    share_beyond: float
    #: The pixel that is farthest off, or the first that is not finite; none where all are equal.
    worst: Union["Worst", None]

class Alert(TypedDict):
    """A fault that was found."""

    #: Branch that was judged; empty for none.
    branch: str
    #: When it was closed.
    closed_at: Union["Timestamp", None]
    #: Who closed it.
    closed_by: Union[str, None]
    #: Why it is closed.
    closed_why: Union[str, None]
    #: In words.
    detail: str
    #: In numbers.
    finding: "Finding2"
    #: Number, rising with time.
    id: int
    #: Its job, if it came from one.
    job_id: Union[int, None]
    #: What kind of check failed.
    kind: "Kind"
    #: The metric's id; empty where no data came at all.
    metric: str
    #: When it was found.
    opened_at: "Timestamp"
    #: Its place in the job.
    preset_index: Union[int, None]
    #: Project.
    project: str
    #: The first bad report, or the last one before silence.
    report_id: Union[int, None]
    #: The line.
    series: "Series"
    #: Where it stands.
    status: "AlertStatus"
    #: When it was last found again.
    updated_at: "Timestamp"

class AlertPage(TypedDict):
    """A page of alerts."""

    #: Newest first.
    alerts: List["Alert"]
    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]

class Baseline(TypedDict):
    """The approved results of a line."""

    #: The worst that rules allow beside them.
    allowed: Union["Value", None]
    #: How many there are.
    n_approved: int
    #: The worst of them; of a metric of unknown direction, their mean.
    worst: "Value"

class BenchPage(TypedDict):
    """A page of benchmarks."""

    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]
    #: Newest job first.
    runs: List["BenchRun"]

class BenchPoint(TypedDict):
    """One setting: what it costs and what it gives."""

    #: What the passes must move at the least: each image they bind once, bytes for a pixel of output.
    bytes_per_pixel: float
    #: The setting that is as fast or faster and as good or better; none on the front.
    dominated_by: Union[str, None]
    #: Mean over frames after warm-up, by metric id.
    metrics: Dict[str, "Value"]
    #: How many times as long the frame takes as moving those bytes once would at the speed of a copy. None where that was not measured.
    over_copy: Union[float, None]
    #: What differs from the preset: parameters and knobs.
    parameters: Dict[str, Any]
    #: Median of each pass by timestamps (on a CPU adapter wall time); none where there are none.
    passes_ms: Dict[str, float]
    #: The most that was allocated on the device at once while this setting ran alone; none where it is not counted.
    peak_gpu_bytes: Union[int, None]
    #: Preset id.
    preset: str
    #: Name of the sequence.
    sequence: str
    #: Share of the resolve's tiles that had nothing to do, 0 to 1.
    skipped: float
    #: Of one frame.
    time_ms: "Timing"
    #: CPU time of the process for bringing a frame to the device, median: comparing it with the one before where tiles may be skipped, and copying what differs. No part of `time_ms`.
    upload_ms: float

#: The body of `POST /bench`.
BenchRequest = TypedDict('BenchRequest', {'bench': "BenchSpecInput", 'branch': 'NotRequired[Union[str, None]]', 'commit': 'NotRequired[Union[str, None]]', 'engine_version': 'NotRequired[Union[str, None]]', 'from': 'NotRequired[Union["DepartureInput", None]]', 'label': 'NotRequired[Union[str, None]]', 'labels': 'NotRequired[Dict[str, str]]', 'parent': 'NotRequired[Union[str, None]]', 'project': 'NotRequired[Union[str, None]]', 'pull_request': 'NotRequired[Union[str, None]]', 'sequence': str})

class BenchRun(TypedDict):
    """A stored benchmark."""

    #: What resolved it.
    adapter: "AdapterInfo"
    #: What a time is.
    clock: "Clock"
    #: Bytes read and written a second, 10⁹, by a pass that does nothing but copy a large image, by the same clock. None in reports older than the figure.
    copy_gb_per_s: Union[float, None]
    #: When it was stored.
    created_at: "Timestamp"
    #: Its job, by which it is asked for.
    job_id: int
    #: Settings that make no sense or cannot run on this sequence, and why.
    left_out: List[str]
    #: What the front is drawn on.
    metric: "MetricId"
    #: What the same setting measured twice differs by.
    noise: "Noise"
    #: Each setting, in the order of presets and knobs.
    points: List["BenchPoint"]
    #: Git revision of the build.
    revision: str
    #: What was resolved.
    sequence: "SequenceInfo"
    #: Content hash of the sequence.
    sequence_hash: str

class BenchSpec(TypedDict):
    """What to measure on a sequence."""

    #: How history is stored unless a knob says so.
    history: "Precision"
    #: Values to try, by the name of a recipe's parameter, or `history`, `skip` or `workgroup`; all combinations are.
    knobs: Dict[str, List[Any]]
    #: The metric that the front is drawn on; one of `metrics`.
    metric: "MetricId"
    #: Which metrics; none where the sequence has no reference.
    metrics: List["MetricId"]
    #: Only the first so many frames.
    n_frames: Union[int, None]
    #: The least number of timed frames, 20 to 1000; frames in warm-up do not count.
    n_timed: int
    #: Which systems.
    presets: List["PresetSpec"]

class BenchSpecInput(TypedDict):
    """What to measure on a sequence."""

    #: How history is stored unless a knob says so.
    history: NotRequired["Precision"]
    #: Values to try, by the name of a recipe's parameter, or `history`, `skip` or `workgroup`; all combinations are.
    knobs: NotRequired[Dict[str, List[Any]]]
    #: The metric that the front is drawn on; one of `metrics`.
    metric: "MetricId"
    #: Which metrics; none where the sequence has no reference.
    metrics: List["MetricId"]
    #: Only the first so many frames.
    n_frames: NotRequired[Union[int, None]]
    #: The least number of timed frames, 20 to 1000; frames in warm-up do not count.
    n_timed: NotRequired[int]
    #: Which systems.
    presets: List["PresetSpecInput"]

class BencherMetric(TypedDict):
    """One measure of a benchmark."""

    #: Lower end of its spread.
    lower_value: NotRequired[Union[float, None]]
    #: Upper end of its spread.
    upper_value: NotRequired[Union[float, None]]
    #: The value.
    value: float

#: Each pass in turn computed by its twin, and the rest on the GPU.
Bisection = TypedDict('Bisection', {'frame': Union[int, None], 'pass': Union[str, None], 'swaps': List["Overview"]})

class Blob(TypedDict):
    """A stored blob."""

    #: Its size.
    n_bytes: int
    #: SHA-256 of its content.
    sha256: str

class Bound(TypedDict):
    """A limit that theory gives."""

    #: The same in letters.
    formula: str
    #: What was measured of it.
    measured: float
    #: In the unit that the formula has.
    value: float

class Bounds(TypedDict):
    """How far two images may be apart, in shares of a display's range: values without a limit count as `x / (1 + |x|)`, variances by their roots, numbers of samples by the share of each."""

    #: Of a pixel, its worst channel.
    max: float
    #: On average over the pixels within `max`.
    mean: float
    #: The share of pixels that may be beyond `max`: those where a decision fell differently (a tie, the edge of a box, a model's reset), which no bound on rounding covers.
    share_beyond: float

class Branch(TypedDict):
    """A branch."""

    #: When its first report came.
    created_at: "Timestamp"
    #: The last commit they share.
    departed_commit: Union[str, None]
    #: Name.
    name: str
    #: The branch that it left.
    parent: Union[str, None]

class BranchList(TypedDict):
    """Branches of a project."""

    #: By name.
    branches: List["Branch"]

class Cell(TypedDict):
    """A hazard, a recipe, a precision, an adapter."""

    #: The adapter's name.
    adapter: str
    #: What theory allows, where it says something.
    bound: Union["Bound", None]
    #: The error by frame; of many frames some, each the worst of those since the one before.
    course: List["ErrorAt"]
    #: SHA-256, in hexadecimal, over the last image shown, bit for bit: what is promised to be equal has an equal one.
    digest: str
    #: The frame that had the largest error, or where it failed.
    frame: Union[int, None]
    #: How the largest error of a frame changed from frame to frame.
    growth: Union["Growth", None]
    #: Whether the recipe keeps what makes it stable.
    guards: "Guards"
    #: Id of the hazard.
    hazard: str
    #: The largest difference from the f64 twin, in display units: 1 is the display's range.
    max_error: "Value"
    #: The largest difference in steps of the history's precision at the twin's value.
    max_error_ulps: "Value"
    #: Frames that ran.
    n_frames: int
    #: The frames of its picture, in the order of the rows: the first, the worst and a disturbed one with those beside them, the last.
    pictured: List[int]
    #: Of stored history.
    precision: "Precision"
    #: Why, in words.
    reason: str
    #: Preset, with what was changed of it.
    recipe: str
    #: Frames from the disturbance until the image was as if nothing had been; none where there was no disturbance, or no end.
    recovered_after: Union[int, None]
    #: Of the input.
    size: "Extent"
    #: How it stood.
    verdict: "StressVerdict"

class Change(TypedDict):
    """A change of level."""

    #: Median after, up to the next change, within the rule's window.
    after: "Value"
    #: Median before, back to the change before, within the rule's window.
    before: "Value"
    #: Its commit.
    commit: Union[str, None]
    #: When it was stored.
    created_at: "Timestamp"
    #: The probability that chance made it.
    p: float
    #: The first report of the new level.
    report_id: int
    #: Whether it is a change for the worse; none of a metric of unknown direction.
    worse: Union[bool, None]

class ChangeRule(TypedDict):
    """Change-point detection: what counts as a change."""

    #: Smaller steps are not worth anyone's time.
    min_effect: "Tolerance"
    #: How many results there must be on either side of a change.
    min_segment: int
    #: The largest probability that chance made the change, by permutation.
    p: float
    #: Look at the newest so many results.
    window: int

class ChangeRuleInput(TypedDict):
    """Change-point detection: what counts as a change."""

    #: Smaller steps are not worth anyone's time.
    min_effect: NotRequired["Tolerance"]
    #: How many results there must be on either side of a change.
    min_segment: NotRequired[int]
    #: The largest probability that chance made the change, by permutation.
    p: NotRequired[float]
    #: Look at the newest so many results.
    window: NotRequired[int]

class Check2(TypedDict):
    """A check and its outcome."""

    #: In words.
    detail: str
    #: In numbers.
    finding: "Finding2"
    #: What kind of check.
    kind: "Kind"
    #: The metric's id.
    metric: str
    #: What became of it.
    outcome: "Outcome"
    #: Its preset or system.
    recipe: str
    #: Name of its sequence.
    sequence: str
    #: The line; none where nothing is stored.
    series_id: Union[int, None]

class Checked(TypedDict):
    """A sequence, and what the convention check says of it."""

    #: What the convention check says of it.
    check: "Check"
    #: Content hash: SHA-256 in hexadecimal.
    hash: str
    #: The manifest as submitted; left out of lists.
    manifest: NotRequired[Any]
    #: Size of its folder in bytes.
    n_bytes: int
    #: Number of frames.
    n_frames: int
    #: The name it was last put under.
    name: str
    #: Size of the reference.
    output_size: "Extent"
    #: When it was last put.
    put_at: "Timestamp"
    #: Size of the engine's frames.
    render_size: "Extent"

class Choice(TypedDict):
    """A name that a parameter can have."""

    #: What it means.
    description: str
    #: As jobs write it.
    name: str

class CloseRequest(TypedDict):
    """The body of `POST /reports/{report}/close`."""

    #: Version of metrics that are not known here.
    metric_versions: NotRequired[Dict[str, int]]
    #: Judge the report by these, and keep them as its line's on the branch.
    rules: NotRequired[Union["RulesInput", None]]

class Decision(TypedDict):
    """A decision about a report."""

    #: When.
    decided_at: "Timestamp"
    #: What was decided.
    decision: "Verdict"
    #: Number, rising with time.
    id: int
    #: The report.
    report_id: int
    #: Its series.
    series_id: int
    #: By whom.
    who: str
    #: Why.
    why: str

class DecisionPage(TypedDict):
    """A page of decisions."""

    #: Newest first; the newest about a report counts.
    decisions: List["Decision"]
    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]

class DecisionRequest(TypedDict):
    """The body of `POST /reports/{report}/decisions`."""

    #: Whether the result belongs to its line's baseline.
    decision: "Verdict"
    #: Who says so, where no token says it.
    who: NotRequired[Union[str, None]]
    #: Why.
    why: str

class DeliveryList(TypedDict):
    """The last deliveries of a webhook."""

    #: Newest first, at most 100.
    deliveries: List["DeliveryStatus"]

class DeliveryStatus(TypedDict):
    """A delivery as the API shows it."""

    #: Attempts so far.
    attempts: int
    #: When it was queued.
    created_at: "Timestamp"
    #: Name of the event.
    event: str
    #: Number.
    id: int
    #: What went wrong last.
    last_error: Union[str, None]
    #: `waiting`, `delivered` or `given_up`.
    status: str

class Departure(TypedDict):
    """Where a branch left another."""

    #: The branch that it left.
    branch: str
    #: The last commit they share; the newest known one where it is left out.
    commit: Union[str, None]

class DepartureInput(TypedDict):
    """Where a branch left another."""

    #: The branch that it left.
    branch: str
    #: The last commit they share; the newest known one where it is left out.
    commit: NotRequired[Union[str, None]]

class Environment(TypedDict):
    """What machine measured. Numbers compare only between equal environments."""

    #: Adapter and driver.
    adapter: "AdapterInfo"
    #: How clocks are held, such as `locked 1410 MHz`; empty where they are not.
    clocks: str
    #: Operating system and its version, such as `debian 12`; empty where unknown.
    os: str

class EnvironmentList(TypedDict):
    """Every environment."""

    #: By number.
    environments: List["EnvironmentListing"]

class EnvironmentListing(TypedDict):
    """An environment that reports were made in."""

    #: Adapter and driver.
    adapter: "AdapterInfo"
    #: How clocks are held, such as `locked 1410 MHz`; empty where they are not.
    clocks: str
    #: Its number, as series carry it.
    id: int
    #: Operating system and its version, such as `debian 12`; empty where unknown.
    os: str

class EnvironmentRequest(TypedDict):
    """What measured, as far as it is known."""

    #: The adapter: its name, and what else is known of it.
    adapter: NotRequired["AdapterRequest"]
    #: How clocks are held, such as `locked 1410 MHz`.
    clocks: NotRequired[str]
    #: Operating system and its version, such as `windows 11 24H2`.
    os: NotRequired[str]

class ErrorAt(TypedDict):
    """The largest error of a frame."""

    #: Display units.
    error: "Value"
    #: Steps of the history's precision at the twin's value.
    error_ulps: "Value"
    #: Which frame.
    frame: int

class Failure(TypedDict):
    """Why a job failed."""

    #: Stable id of the cause.
    code: str
    #: Whose fault.
    kind: "FailureKind"
    #: For people: names the file, frame or field, and what to do.
    message: str

class Finding(TypedDict):
    """Something that looks wrong."""

    #: The numbers.
    evidence: Dict[str, float]
    #: Stable name, such as `motion.y`.
    id: str
    #: One sentence with the numbers that matter.
    message: str
    #: How much it matters.
    severity: "Severity"
    #: What to change in the manifest, where that can mend it.
    suggestions: List["Suggestion"]

class Finding2(TypedDict):
    """What was found, as far as it applies."""

    #: How far the value lies from what was before or approved; its sign is the value's change.
    effect: Union["Value", None]
    #: Upper end of the effect's 95 % interval.
    effect_high: Union["Value", None]
    #: Lower end of the effect's 95 % interval.
    effect_low: Union["Value", None]
    #: Its commit.
    first_bad_commit: Union[str, None]
    #: The first report that is bad.
    first_bad_report: Union[int, None]
    #: Its commit.
    last_good_commit: Union[str, None]
    #: The last report that was good.
    last_good_report: Union[int, None]
    #: What it was held against.
    limit: Union["Value", None]
    #: The value judged: the median of the repeats, or NaN where one of them is.
    value: Union["Value", None]
    #: Frames of the judged report that are worst, worst first.
    worst_frames: List[int]

class FrameAgreement(TypedDict):
    """One frame on both sides."""

    #: Position in the sequence, from 0.
    index: int
    #: In their order.
    passes: List["PassAgreement"]
    #: History was dropped before it.
    reset: bool
    #: What is shown.
    shown: "Agreement"

class FrameList(TypedDict):
    """Every frame of a report."""

    #: In order.
    frames: List["FrameReport"]

class FrameReport(TypedDict):
    """One frame of one preset."""

    #: Position in the sequence, from 0.
    index: int
    #: By metric id.
    metrics: Dict[str, "Value"]
    #: Pixels of output or reference with a non-finite component. Any at all fails the verdict.
    non_finite_pixels: int
    #: Texels whose colour had a non-finite, negative or overflowing component.
    repaired_texels: int
    #: History was dropped before this frame.
    reset: bool
    #: By pass (`prepare`, `resolve` and others: GPU timestamps, median of the repeats) and host stage (`host_cpu`, `decode`, `upload`, `readback`, `metrics`: wall time of that stage, `host_cpu`: CPU time of the submitting thread).
    times_ms: Dict[str, float]
    #: The frame lies within the manifest's `warmup_frames` after a reset: stored, but not summarised.
    warmup: bool

class FrameRequest(TypedDict):
    """One frame's numbers."""

    #: Position in the sequence, from 0.
    index: int
    #: By metric.
    metrics: NotRequired[Dict[str, "Value"]]
    #: Pixels with a component that is not finite.
    non_finite_pixels: NotRequired[int]
    #: History was dropped before this frame.
    reset: NotRequired[bool]
    #: GPU time by pass, milliseconds.
    times_ms: NotRequired[Dict[str, float]]
    #: The frame is kept but not summarised.
    warmup: NotRequired[bool]

class FramesPosted(TypedDict):
    """How many frames were taken."""

    #: The report.
    id: int
    #: How many.
    n_frames: int

class FramesRequest(TypedDict):
    """The body of `POST /reports/{report}/frames`."""

    #: More frames; where a frame is there already, its metrics and times are added to.
    frames: List["FrameRequest"]

class Growth(TypedDict):
    """A trend and its rate."""

    #: Display units a frame where linear, natural logarithm of the factor a frame where exponential, else 0.
    rate: float
    #: Which kind of curve fits best.
    trend: "GrowthTrend"

class Health(TypedDict):
    """What answers."""

    #: Git revision of the build.
    revision: str
    #: `ok`.
    status: str
    #: Version of the program.
    version: str

#: A stored job.
Job = TypedDict('Job', {'attempts': int, 'branch': Union[str, None], 'cancel_requested': bool, 'commit': Union[str, None], 'created_at': "Timestamp", 'engine_version': Union[str, None], 'error': Union["Failure", None], 'finished_at': Union["Timestamp", None], 'from': Union["Departure", None], 'id': int, 'label': Union[str, None], 'labels': Dict[str, str], 'n_done': int, 'n_total': int, 'parent': Union[str, None], 'project': str, 'pull_request': Union[str, None], 'sequence_hash': 'NotRequired[str]', 'sequence_name': 'NotRequired[str]', 'spec': "JobSpec", 'started_at': Union["Timestamp", None], 'status': "Status"})

class JobPage(TypedDict):
    """A page of jobs."""

    #: Newest first.
    jobs: List["Job"]
    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]

#: The body of `POST /jobs`: presets to run, or images rendered elsewhere to compare.
JobRequest = TypedDict('JobRequest', {'bisect': 'NotRequired[bool]', 'branch': 'NotRequired[Union[str, None]]', 'commit': 'NotRequired[Union[str, None]]', 'engine_version': 'NotRequired[Union[str, None]]', 'force': 'NotRequired[bool]', 'frames': 'NotRequired[Union[int, None]]', 'from': 'NotRequired[Union["DepartureInput", None]]', 'history': 'NotRequired["Precision"]', 'images': 'NotRequired["Images"]', 'label': 'NotRequired[Union[str, None]]', 'labels': 'NotRequired[Dict[str, str]]', 'metrics': 'NotRequired[List["MetricId"]]', 'outputs': 'NotRequired[Union["OutputsRequest", None]]', 'parent': 'NotRequired[Union[str, None]]', 'presets': 'NotRequired[List["PresetRequest"]]', 'project': 'NotRequired[Union[str, None]]', 'pull_request': 'NotRequired[Union[str, None]]', 'repeat': 'NotRequired[int]', 'sequence': str, 'skip': 'NotRequired["Skip"]', 'until': 'NotRequired[Union["Until", None]]', 'validate': 'NotRequired[bool]'})

class JobSpec(TypedDict):
    """Everything a worker must know to do a job."""

    #: Instead of running presets once, the settings to measure.
    bench: NotRequired[Union["BenchSpec", None]]
    #: How history is stored.
    history: "Precision"
    #: Which output images to keep.
    images: "Images"
    #: Which metrics; left out where the sequence has no reference.
    metrics: List["MetricId"]
    #: Where metrics are computed.
    metrics_on: "MetricsOn"
    #: Run only the first so many frames.
    n_frames: Union[int, None]
    #: Images rendered elsewhere, to be compared instead of running presets.
    outputs: NotRequired[Union["Outputs", None]]
    #: Which systems.
    presets: List["PresetSpec"]
    #: How often each GPU pass of a frame is timed, 1 to 100.
    repeat: int
    #: Which work may be left out.
    skip: "Skip"
    #: Instead of running anything on a sequence, the matrix to try recipes with.
    stress: NotRequired[Union["StressSpec", None]]
    #: Ends the run before its last frame where that is enough.
    until: Union["Until", None]
    #: Whether the adapter is held against the twin on the CPU.
    validate: "Validate"

#: A job and, once it is done, its reports.
JobWithReports = TypedDict('JobWithReports', {'answered_from_store': 'NotRequired[bool]', 'attempts': int, 'branch': Union[str, None], 'cancel_requested': bool, 'commit': Union[str, None], 'created_at': "Timestamp", 'engine_version': Union[str, None], 'error': Union["Failure", None], 'finished_at': Union["Timestamp", None], 'from': Union["Departure", None], 'id': int, 'label': Union[str, None], 'labels': Dict[str, str], 'n_done': int, 'n_total': int, 'parent': Union[str, None], 'project': str, 'pull_request': Union[str, None], 'reports': List["Report"], 'sequence_hash': 'NotRequired[str]', 'sequence_name': 'NotRequired[str]', 'spec': "JobSpec", 'started_at': Union["Timestamp", None], 'status': "Status"})

class Judgement(TypedDict):
    """What the rules say."""

    #: Numbers of the alerts that this opened: of the newest results, where these are of a commit before.
    alerts: List[int]
    #: Every check.
    checks: List["Check2"]
    #: A regression if there is any; else unknown if anything could not be told.
    outcome: "Outcome"

class Listing(TypedDict):
    """A metric as lists show it."""

    #: Which way it improves.
    better: "Better"
    #: One line for people.
    description: str
    #: Stored id; never changes.
    id: str
    #: The masks that it can be taken over, by what is put behind its id.
    masks: List[str]
    #: `dB`, or empty for a pure number.
    unit: str
    #: Raised when the numbers change.
    version: int

class Marks(TypedDict):
    """What lies behind a line."""

    #: What was approved.
    baseline: Union["Baseline", None]
    #: The branch whose rules these are; none where no branch has any for this line.
    branch: Union[str, None]
    #: Where the line changed its level in the rule's window, oldest first, with the change that an alert is open of.
    changes: List["Change"]
    #: The most that is good enough.
    max: Union["Value", None]
    #: The least that is good enough.
    min: Union["Value", None]

class Matrix(TypedDict):
    """A matrix with its cells."""

    #: What ran it.
    adapter: "AdapterInfo"
    #: Hazard by hazard, then recipe by recipe, then by precision.
    cells: List["Cell"]
    #: When it was stored.
    created_at: "Timestamp"
    #: Its job, by which it is asked for.
    job_id: int
    #: Cells in all.
    n_cells: int
    #: Those that failed.
    n_failed: int
    #: Revision of the service that ran.
    revision: str
    #: What noise and places were chosen by.
    seed: int

class NewWebhook(TypedDict):
    """A new webhook with its secret, which is shown this once."""

    #: When it was made.
    created_at: "Timestamp"
    #: Number.
    id: int
    #: Project whose verdicts it hears of.
    project: str
    #: Signs every delivery.
    secret: str
    #: Where to.
    url: str

class Noise(TypedDict):
    """What the same setting measured twice differs by. No two times nearer than that are called different."""

    #: How many frames each.
    n_frames: int
    #: 95 % interval of the median ratio.
    ratio: List[float]
    #: The most that the paired ratio of both measurements may be from 1, with 95 % confidence.
    relative: float
    #: Which setting.
    setting: str

class Outputs(TypedDict):
    """Images of a system elsewhere."""

    #: What rendered them.
    environment: "Environment"
    #: By frame index: SHA-256 of a blob that holds the image.
    images: Dict[str, Any]
    #: Its settings.
    parameters: Dict[str, Any]
    #: The system's name.
    system: str

class OutputsRequest(TypedDict):
    """Images of a system elsewhere."""

    #: What rendered them.
    environment: NotRequired["EnvironmentRequest"]
    #: SHA-256 of the blob with each frame's image, by frame index. EXR is linear RGB; other formats are read as the sequence's reference is.
    images: Dict[str, str]
    #: Its settings; other settings are another line.
    parameters: NotRequired[Dict[str, Any]]
    #: The system's name.
    system: str

class Overview(TypedDict):
    """Over all frames."""

    #: Every frame does.
    agrees: bool
    #: The first that does.
    first_disagreeing_frame: Union[int, None]
    #: The largest distance of a pixel.
    max: float
    #: The largest mean of a frame.
    mean: float
    #: Pixels beyond the bound, in all frames.
    n_beyond: int
    #: How many frames disagree.
    n_disagreeing_frames: int
    #: Pixels beyond it that 32-bit arithmetic does not determine, in all frames.
    n_undetermined: int
    #: The pass; `shown` of frames.
    name: str
    #: Pixels that are not finite on the GPU, in all frames.
    non_finite_gpu: int
    #: And in the twin.
    non_finite_twin: int
    #: The largest share of a frame's.
    share_beyond: float
    #: That pixel.
    worst: Union["Worst", None]
    #: The frame with the worst pixel; none where all are equal.
    worst_frame: Union[int, None]

class Parameter(TypedDict):
    """A parameter of a recipe."""

    #: What it is in a preset that does not say.
    default: Any
    #: What it is.
    description: str
    #: As jobs write it, and as shaders do.
    name: str
    #: Of its values, where they have one.
    unit: Union[str, None]
    type: NotRequired[Union[Literal['choice'], Literal['flag'], Literal['integer'], Literal['number']]]
    values: NotRequired[List["Choice"]]
    excludes_min: NotRequired[bool]
    max: NotRequired[float]
    min: NotRequired[float]
    odd: NotRequired[bool]

#: What one pass wrote.
PassAgreement = TypedDict('PassAgreement', {'agrees': bool, 'max': float, 'mean': float, 'n_beyond': int, 'n_undetermined': int, 'non_finite_gpu': int, 'non_finite_twin': int, 'pass': str, 'share_beyond': float, 'worst': Union["Worst", None]})

class Point(TypedDict):
    """A metric at one point in time."""

    #: Branch the submitter gave.
    branch: Union[str, None]
    #: Commit the submitter gave.
    commit: Union[str, None]
    #: When it was stored.
    created_at: "Timestamp"
    #: The job of that report, if it came from one.
    job_id: Union[int, None]
    #: Version of the metric; only equal ones compare. 0 for times.
    metric_version: int
    #: The commit before, as the submitter gave it.
    parent: Union[str, None]
    #: The report it stands for.
    report_id: int
    #: The value.
    value: "Value"

class PointList(TypedDict):
    """Points of a series."""

    #: How many there were before thinning.
    n_points: int
    #: Oldest first.
    points: List["Point"]

class Posted(TypedDict):
    """A stored report."""

    #: Whether it is whole.
    complete: bool
    #: Its number.
    id: int
    #: What its rules say, if any were sent.
    judgement: Union["Judgement", None]

class PostedAll(TypedDict):
    """Reports of one post."""

    #: Their numbers.
    ids: List[int]

class Preset(TypedDict):
    """A published system."""

    #: What it is.
    description: str
    #: Stored id; never changes.
    id: str
    #: The jitter that it was tuned for, where nothing is upscaled.
    jitter: str
    #: Where it was published.
    publication: str
    #: Its parameters.
    recipe: "Recipe"

class PresetSpec(TypedDict):
    """One preset of a run, with overridden parameters."""

    #: Recipe parameters that replace the preset's, by name.
    parameters: Dict[str, Any]
    #: Preset id, such as `karis2014`.
    preset: str

class PresetSpecInput(TypedDict):
    """One preset of a run, with overridden parameters."""

    #: Recipe parameters that replace the preset's, by name.
    parameters: NotRequired[Dict[str, Any]]
    #: Preset id, such as `karis2014`.
    preset: str

class ProjectList(TypedDict):
    """Every project."""

    #: Names.
    projects: List[str]

class Range(TypedDict):
    """What numbers are allowed."""

    #: The smallest is itself too small.
    excludes_min: bool
    #: The largest.
    max: float
    #: The smallest, or what all must be above.
    min: float
    #: Only odd ones.
    odd: bool

class Reason(TypedDict):
    """Why, and by whom."""

    #: Who says so, where no token says it.
    who: NotRequired[Union[str, None]]
    #: Why.
    why: str

class Recipe(TypedDict):
    """Every parameter of the temporal pipeline."""

    #: What resolves a frame.
    algorithm: "Algorithm"
    #: Make the chroma of a `ycocg` box an eighth of its luma range to either side of the current colour's.
    chroma_from_luma: bool
    #: The smallest weight of `count`.
    count_weight_min: float
    #: Weight of the current colour where `weight` is `fixed`.
    current_weight: float
    #: Clamp filtered history to the 4 texels around the position.
    deringing: bool
    #: Which texel's motion vector a pixel uses, over the 3×3 around it.
    dilation: "Dilation"
    #: The domain in which colours are compared, blended and stored.
    domain: "Domain"
    #: What keeps values finite and bounded; `off` shows what the literal formulas do.
    guards: "Guards"
    #: Whether bright colours count less in the blend.
    hdr_weight: "HdrWeight"
    #: Store history as f32 whatever the job says, for averages longer than f16 can hold.
    history_always_f32: bool
    #: How history is read at the reprojected position.
    history_filter: "HistoryFilter"
    #: How the current colour is read.
    input_filter: "InputFilter"
    #: Intersect the variance box with the 3×3 minimum and maximum.
    intersect_minmax: bool
    #: Weight of history where its luma agrees, for `luma_feedback`.
    luma_feedback_hi: float
    #: Weight of history where its luma differs most, for `luma_feedback`.
    luma_feedback_lo: float
    #: Show fast pixels blurred along their motion instead of resolved.
    motion_blur: bool
    #: Raise the weight with motion.
    motion_weight: bool
    #: Motion at which the weight begins to rise.
    motion_weight_from_px: float
    #: Motion at which the weight reaches 1; above `motion_weight_from_px`.
    motion_weight_to_px: float
    #: The colour box of the current neighbourhood.
    neighbourhood: "Neighbourhood"
    #: With `phlm2016`, refresh the feature by the formula as printed, a power too high and without a floor.
    phlm_printed: bool
    #: Find mean and deviation in two passes whose cost does not depend on the window.
    prefilter_moments: bool
    #: Raise the weight to the sequence's reactive mask.
    reactive: bool
    #: What is done to history outside the box.
    rectify: "Rectify"
    #: Treat history as absent where the previous depth does not fit.
    reject_depth: bool
    #: The largest difference of depth that still fits, as a share of the depth expected.
    reject_depth_tolerance: float
    #: Treat history as absent where it is of another object.
    reject_id: bool
    #: Look history up where the motion vector points; otherwise in the same pixel.
    reproject: bool
    #: How the shown image is sharpened.
    sharpen: "Sharpen"
    #: How much of the kernel's effect.
    sharpen_strength: float
    #: Which colour is resolved.
    source: "Source"
    #: The colour space of box and rectification.
    space: "Space"
    #: Anti-aliasing of each frame by itself, before everything else.
    spatial: "Spatial"
    #: Decode the sRGB of the domain `display` before a spatial filter mixes colours and encode after, as a sampler of an sRGB texture does.
    spatial_decodes: bool
    #: Read the box's texels at the jitter-free grid, bilinearly.
    unjitter_neighbourhood: bool
    #: Half extent of the variance box.
    variance_gamma: float
    #: Side of the variance box's window.
    variance_window: int
    #: How the weight of the current colour is found.
    weight: "Weight"

class RecipeList(TypedDict):
    """Every preset with its parameters."""

    #: In the order of `GET /presets`.
    recipes: List["RecipeListing"]

class RecipeListing(TypedDict):
    """A preset with its parameters described."""

    #: What it is.
    description: str
    #: Preset id.
    id: str
    #: Every parameter, with the preset's value as default.
    parameters: List["Parameter"]
    #: Where it was published.
    publication: str

#: A stored report without its frames.
Report = TypedDict('Report', {'adapter': "AdapterInfo", 'branch': Union[str, None], 'clocks': str, 'commit': Union[str, None], 'complete': bool, 'created_at': "Timestamp", 'engine_version': Union[str, None], 'environment_id': int, 'from': Union["Departure", None], 'gpu_time_ms': Union[float, None], 'history': Union["Precision", None], 'id': int, 'job_id': Union[int, None], 'kind': "SystemKind", 'label': Union[str, None], 'labels': Dict[str, str], 'metric_versions': Dict[str, int], 'n_frames': Union[int, None], 'notes': List[str], 'os': str, 'overrides': Dict[str, Any], 'parameters': Any, 'parent': Union[str, None], 'preset': str, 'preset_index': int, 'project': str, 'pull_request': Union[str, None], 'revision': str, 'sequence_hash': Union[str, None], 'sequence_name': str, 'series_id': int, 'skip': Union["Skip", None], 'stages_ms': Dict[str, float], 'summary': Dict[str, "Summary"], 'times_ms': Dict[str, "TimeSummary"], 'validation': Union["Validation", None], 'values': Dict[str, "Value"]})

class ReportPage(TypedDict):
    """A page of reports."""

    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]
    #: Newest first.
    reports: List["Report"]

#: The body of `POST /reports`.
ReportRequest = TypedDict('ReportRequest', {'branch': 'NotRequired[Union[str, None]]', 'commit': 'NotRequired[Union[str, None]]', 'engine_version': 'NotRequired[Union[str, None]]', 'environment': 'NotRequired["EnvironmentRequest"]', 'frames': 'NotRequired[List["FrameRequest"]]', 'from': 'NotRequired[Union["DepartureInput", None]]', 'label': 'NotRequired[Union[str, None]]', 'labels': 'NotRequired[Dict[str, str]]', 'metric_versions': 'NotRequired[Dict[str, int]]', 'notes': 'NotRequired[List[str]]', 'open': 'NotRequired[bool]', 'parameters': 'NotRequired[Dict[str, Any]]', 'parent': 'NotRequired[Union[str, None]]', 'project': 'NotRequired[Union[str, None]]', 'pull_request': 'NotRequired[Union[str, None]]', 'rules': 'NotRequired[Union["RulesInput", None]]', 'sequence': str, 'system': str, 'values': 'NotRequired[Dict[str, "Value"]]'})

class Rule(TypedDict):
    """What must hold of some metrics on some sequences of some recipes."""

    #: How much worse than the worst approved result of the same environment it may be.
    baseline: NotRequired[Union["Tolerance", None]]
    #: Which way a metric improves that is not known here.
    better: NotRequired[Union["Better", None]]
    #: Watch for a change for the worse in the line's history.
    change: NotRequired[Union["ChangeRule", None]]
    #: The most that is good enough.
    max: NotRequired[Union[float, None]]
    #: Metrics by id; `*` stands for any text, `?` for one character.
    metric: str
    #: The least that is good enough.
    min: NotRequired[Union[float, None]]
    #: Presets, or systems elsewhere, by name; wildcards as in `metric`.
    recipe: str
    #: Sequences by name; wildcards as in `metric`.
    sequence: str

class RuleInput(TypedDict):
    """What must hold of some metrics on some sequences of some recipes."""

    #: How much worse than the worst approved result of the same environment it may be.
    baseline: NotRequired[Union["Tolerance", None]]
    #: Which way a metric improves that is not known here.
    better: NotRequired[Union["Better", None]]
    #: Watch for a change for the worse in the line's history.
    change: NotRequired[Union["ChangeRuleInput", None]]
    #: The most that is good enough.
    max: NotRequired[Union[float, None]]
    #: Metrics by id; `*` stands for any text, `?` for one character.
    metric: str
    #: The least that is good enough.
    min: NotRequired[Union[float, None]]
    #: Presets, or systems elsewhere, by name; wildcards as in `metric`.
    recipe: NotRequired[str]
    #: Sequences by name; wildcards as in `metric`.
    sequence: NotRequired[str]

class Rules(TypedDict):
    """A rules file."""

    #: A line without a report for so many nights is an alert; none where left out.
    no_data_nights: Union[int, None]
    #: The limits. Every rule that matches counts; a later one replaces the same check of an earlier one.
    rule: List["Rule"]

class RulesInput(TypedDict):
    """A rules file."""

    #: A line without a report for so many nights is an alert; none where left out.
    no_data_nights: NotRequired[Union[int, None]]
    #: The limits. Every rule that matches counts; a later one replaces the same check of an earlier one.
    rule: NotRequired[List["RuleInput"]]

class Sequence(TypedDict):
    """A stored sequence."""

    #: Content hash: SHA-256 in hexadecimal.
    hash: str
    #: The manifest as submitted; left out of lists.
    manifest: NotRequired[Any]
    #: Size of its folder in bytes.
    n_bytes: int
    #: Number of frames.
    n_frames: int
    #: The name it was last put under.
    name: str
    #: Size of the reference.
    output_size: "Extent"
    #: When it was last put.
    put_at: "Timestamp"
    #: Size of the engine's frames.
    render_size: "Extent"

class SequenceInfo(TypedDict):
    """The sequence a report speaks of."""

    #: Content hash: SHA-256 in hexadecimal over manifest and files.
    hash: str
    #: Number of frames that ran.
    n_frames: int
    #: Name from the manifest.
    name: str
    #: Size of the reference and of the resolved image.
    output_size: "Extent"
    #: Size of the engine's frames.
    render_size: "Extent"

class SequencePage(TypedDict):
    """A page of sequences."""

    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]
    #: Newest content first, without manifests.
    sequences: List["Sequence"]

class SequenceRequest(TypedDict):
    """The body of `POST /sequences`."""

    #: SHA-256 of each file that the manifest refers to, by its path there. The blobs must have been put.
    files: Dict[str, str]
    #: The manifest, as `manifest.json` would have it.
    manifest: Dict[str, Any]
    #: The name to find it by.
    name: str

class Series(TypedDict):
    """What two reports must share to be comparable."""

    #: Adapter and driver.
    adapter: "AdapterInfo"
    #: How clocks are held, such as `locked 1410 MHz`; empty where they are not.
    clocks: str
    #: The machine; equal numbers mean equal environments.
    environment_id: int
    #: How history was stored; none where unknown.
    history: Union["Precision", None]
    #: Whether it ran here or elsewhere.
    kind: "SystemKind"
    #: Over how many frames, from the first; none for all of them.
    n_frames: Union[int, None]
    #: Operating system and its version, such as `debian 12`; empty where unknown.
    os: str
    #: The parameters that the submitter changed.
    overrides: Dict[str, Any]
    #: The recipe in full.
    parameters: Any
    #: Preset id, or the external system's name.
    preset: str
    #: Project.
    project: str
    #: Content hash of the sequence; none where only its name is known.
    sequence_hash: Union[str, None]
    #: Name of the sequence.
    sequence_name: str
    #: Row id.
    series_id: int
    #: Which work was left out; none where unknown.
    skip: Union["Skip", None]

class StressPage(TypedDict):
    """A page of matrices."""

    #: Where the next page begins; none after the last.
    next_cursor: Union["Cursor", None]
    #: Newest job first, without their cells.
    runs: List["StressRun"]

#: The body of `POST /stress`.
StressRequest = TypedDict('StressRequest', {'branch': 'NotRequired[Union[str, None]]', 'commit': 'NotRequired[Union[str, None]]', 'engine_version': 'NotRequired[Union[str, None]]', 'from': 'NotRequired[Union["DepartureInput", None]]', 'label': 'NotRequired[Union[str, None]]', 'labels': 'NotRequired[Dict[str, str]]', 'parent': 'NotRequired[Union[str, None]]', 'project': 'NotRequired[Union[str, None]]', 'pull_request': 'NotRequired[Union[str, None]]', 'stress': 'NotRequired["StressSpecInput"]'})

class StressRun(TypedDict):
    """A stored matrix, without its cells."""

    #: What ran it.
    adapter: "AdapterInfo"
    #: When it was stored.
    created_at: "Timestamp"
    #: Its job, by which it is asked for.
    job_id: int
    #: Cells in all.
    n_cells: int
    #: Those that failed.
    n_failed: int
    #: Revision of the service that ran.
    revision: str
    #: What noise and places were chosen by.
    seed: int

class StressSpec(TypedDict):
    """Which cells to run."""

    #: Do every frame of very many, even where the state repeats.
    every_frame: bool
    #: With what makes recipes stable, or without.
    guards: List["Guards"]
    #: Ids of hazards, or of their families; all where empty.
    hazards: List[str]
    #: Number of frames; each hazard's own where left out.
    n_frames: Union[int, None]
    #: How history is stored.
    precisions: List["Precision"]
    #: Which recipes; every preset where empty.
    presets: List["PresetSpec"]
    #: Fewer hazards, and fewer frames of them.
    quick: bool
    #: Chooses noise and places.
    seed: int
    #: Size of the frames, pixels; each hazard's own where left out. Hazards of shape keep theirs.
    size: Union["Extent", None]

class StressSpecInput(TypedDict):
    """Which cells to run."""

    #: Do every frame of very many, even where the state repeats.
    every_frame: NotRequired[bool]
    #: With what makes recipes stable, or without.
    guards: NotRequired[List["Guards"]]
    #: Ids of hazards, or of their families; all where empty.
    hazards: NotRequired[List[str]]
    #: Number of frames; each hazard's own where left out.
    n_frames: NotRequired[Union[int, None]]
    #: How history is stored.
    precisions: NotRequired[List["Precision"]]
    #: Which recipes; every preset where empty.
    presets: NotRequired[List["PresetSpecInput"]]
    #: Fewer hazards, and fewer frames of them.
    quick: NotRequired[bool]
    #: Chooses noise and places.
    seed: NotRequired[int]
    #: Size of the frames, pixels; each hazard's own where left out. Hazards of shape keep theirs.
    size: NotRequired[Union["Extent", None]]

class Suggestion(TypedDict):
    """A field of the manifest and the value that fits."""

    #: Such as `motion.y`.
    field: str
    #: Such as `"down"`.
    value: Any

class Summary(TypedDict):
    """One metric over the frames of a sequence."""

    #: How many frames are infinite.
    infinite: int
    #: Mean of the finite frames; of `flicker` their root mean square. Where there are none, the infinity that all frames share, or NaN.
    mean: "Value"
    #: Smallest value of all frames but NaN ones.
    min: "Value"
    #: How many frames are NaN. Any at all means that the other fields speak of fewer frames than ran.
    nan: int
    #: 5th percentile of all frames but NaN ones: linear between order statistics, rank 0.05·(n − 1) counted from 0.
    p5: "Value"
    #: For PSNRs: the PSNR of the mean of the frames' mean squared errors. Equal frames count as error 0.
    pooled: NotRequired[Union["Value", None]]

class ThresholdList(TypedDict):
    """Rules of every branch."""

    #: By project and branch, one a rules file.
    thresholds: List["Thresholds"]

class Thresholds(TypedDict):
    """Rules of lines of a branch."""

    #: Branch; empty for none.
    branch: str
    #: Project.
    project: str
    #: The rules that their last run was sent with.
    rules: "Rules"
    #: The lines.
    series: List[int]

class TimeSummary(TypedDict):
    """Repeated measurements of one pass."""

    #: Median absolute deviation from the median.
    mad: float
    #: Middle value.
    median: float
    #: Smallest value: the least disturbed.
    min: float
    #: How many measurements.
    n: int

class Timing(TypedDict):
    """Repeated measurements of one thing, milliseconds."""

    #: Upper end.
    high: float
    #: Lower end of the 95 % interval of the median.
    low: float
    #: Median absolute deviation from the median.
    mad: float
    #: Middle value.
    median: float

class Token(TypedDict):
    """A token as it is stored, without anything that would let someone use it."""

    #: When it was made.
    created_at: "Timestamp"
    #: When it ends by itself.
    expires_at: Union["Timestamp", None]
    #: The token's first characters, by which its owner tells it from others.
    handle: str
    #: Number.
    id: int
    #: For people.
    name: str
    #: Requests a minute; none for no limit.
    rate_per_minute: Union[int, None]
    #: When it was revoked.
    revoked_at: Union["Timestamp", None]
    #: What it allows.
    scopes: List["Scope"]

class TokenList(TypedDict):
    """Every token."""

    #: Without anything that would let someone use them.
    tokens: List["Token"]

class Trend(TypedDict):
    """One line of a trend."""

    #: Adapter and driver.
    adapter: "AdapterInfo"
    #: How clocks are held, such as `locked 1410 MHz`; empty where they are not.
    clocks: str
    #: The machine; equal numbers mean equal environments.
    environment_id: int
    #: How history was stored; none where unknown.
    history: Union["Precision", None]
    #: Whether it ran here or elsewhere.
    kind: "SystemKind"
    #: Over how many frames, from the first; none for all of them.
    n_frames: Union[int, None]
    #: Operating system and its version, such as `debian 12`; empty where unknown.
    os: str
    #: The parameters that the submitter changed.
    overrides: Dict[str, Any]
    #: The recipe in full.
    parameters: Any
    #: Oldest first.
    points: List["Point"]
    #: Preset id, or the external system's name.
    preset: str
    #: Project.
    project: str
    #: Content hash of the sequence; none where only its name is known.
    sequence_hash: Union[str, None]
    #: Name of the sequence.
    sequence_name: str
    #: Row id.
    series_id: int
    #: Which work was left out; none where unknown.
    skip: Union["Skip", None]

class TrendList(TypedDict):
    """Lines of one metric."""

    #: The metric's id.
    metric: str
    #: One for each combination of sequence, recipe and environment that has points.
    series: List["Trend"]

class Undecided(TypedDict):
    """A convention that the pixels do not tell."""

    #: Such as `motion.y`.
    field: str
    #: Why not.
    reason: str

class Validation(TypedDict):
    """A recipe over a sequence, on the adapter and on its twin."""

    #: Every pass of every frame agrees, and every frame shown.
    agrees: bool
    #: Which pass is wrong, where that was asked for and any is.
    bisection: Union["Bisection", None]
    #: What is allowed of the frames shown; none where they are measured only, as with a 16-bit history that decides more than a blend.
    frame_bounds: Union["Bounds", None]
    #: In their order.
    frames: NotRequired[List["FrameAgreement"]]
    #: What is allowed of each pass, given the same inputs as its twin.
    pass_bounds: "Bounds"
    #: In their order, against a twin of the GPU's own inputs.
    passes: List["Overview"]
    #: The frames shown, against a twin that runs by itself.
    shown: "Overview"

class VerdictRequest(TypedDict):
    """The body of `POST /verdicts`."""

    #: Reports by number, all of one branch. Those of one line are repeats of one measurement: their median is judged.
    reports: List[int]
    #: The rules file as JSON.
    rules: "RulesInput"

class Webhook(TypedDict):
    """An address that hears of verdicts."""

    #: When it was made.
    created_at: "Timestamp"
    #: Number.
    id: int
    #: Project whose verdicts it hears of.
    project: str
    #: Where to.
    url: str

class WebhookList(TypedDict):
    """Every webhook."""

    #: Without their secrets.
    webhooks: List["Webhook"]

class WebhookRequest(TypedDict):
    """The body of `POST /webhooks`."""

    #: Whose verdicts; `default` where left out.
    project: NotRequired[Union[str, None]]
    #: Where to: `https://…`, or `http://…`.
    url: str

class Worst(TypedDict):
    """A pixel of an image that a pass writes."""

    #: The image's name in the pass's shader.
    image: str
    #: Column and row.
    pixel: List[int]

#: Where an alert stands.
AlertStatus = Union[Literal['dismissed'], Literal['open'], Literal['resolved']]

#: What resolves a frame.
Algorithm = Union[Literal['checkerboard'], Literal['phlm2016'], Literal['temporal']]

#: Bencher's metric JSON: by benchmark, by measure.
BencherRequest = Dict[str, Dict[str, "BencherMetric"]]

#: Which way a metric improves.
Better = Union[Literal['higher'], Literal['lower']]

#: Where the check of a sequence stands.
Check = Dict[str, Any]

#: What a time is.
Clock = Union[Literal['gpu_timestamps'], Literal['process_cpu']]

#: The `next_cursor` of the page before.
Cursor = str

#: Which texel's motion vector a pixel uses, over the 3×3 around it.
Dilation = Union[Literal['closest'], Literal['longest'], Literal['none']]

#: The domain in which colours are compared, blended and stored.
Domain = Union[Literal['display'], Literal['linear'], Literal['tonemapped']]

#: Width and height in pixels. Written `[width, height]` in JSON.
Extent = List[int]

#: Whose fault a failure is. Only [`FailureKind::Device`] is worth another try.
FailureKind = Union[Literal['device'], Literal['input'], Literal['internal']]

#: How an error behaves over frames.
GrowthTrend = Union[Literal['bounded'], Literal['exponential'], Literal['linear']]

#: What keeps values finite and bounded where a formula alone would not: the repair of hostile colours, the smallest divisors, moments about a shift, stores that round and saturate, the limits of what is fitted. `docs/stress.md` lists them.
Guards = Union[Literal['off'], Literal['on']]

#: Whether bright colours count less in the blend.
HdrWeight = Union[Literal['karis'], Literal['none']]

#: How history is read at the reprojected position.
HistoryFilter = Union[Literal['bfecc'], Literal['bilinear'], Literal['catmull_rom'], Literal['catmull_rom_5'], Literal['none'], Literal['quasi_cubic'], Literal['texel']]

#: Which precision output images are kept in.
Images = Union[Literal['float'], Literal['half'], Literal['none']]

#: How the current colour is read.
InputFilter = Union[Literal['blackman_harris'], Literal['texel'], Literal['unjitter'], Literal['upsample']]

#: What kind of check.
Kind = Union[Literal['baseline'], Literal['change'], Literal['limit'], Literal['no_data']]

#: A metric's id, such as `psnr`, or over a mask, such as `psnr.moving`. `/api/v1/metrics` lists them.
MetricId = str

#: Where metrics are computed: the values agree, the times do not.
MetricsOn = Union[Literal['auto'], Literal['cpu'], Literal['gpu']]

#: The colour box of the current neighbourhood.
Neighbourhood = Union[Literal['box3'], Literal['cross'], Literal['none'], Literal['rounded'], Literal['shrunk'], Literal['sobel'], Literal['variance']]

#: What became of a check.
Outcome = Union[Literal['ok'], Literal['regression'], Literal['unknown']]

#: How history is stored between frames.
Precision = Union[Literal['f16'], Literal['f32']]

#: A preset's id, or an object with `preset` and `parameters`.
PresetRequest = Union["PresetSpecInput", str]

#: What is done to history outside the box.
Rectify = Union[Literal['clamp'], Literal['clip_centre'], Literal['clip_current'], Literal['hull'], Literal['none']]

#: What a token allows.
Scope = Union[Literal['admin'], Literal['approve'], Literal['read'], Literal['submit']]

#: How much a finding matters.
Severity = Union[Literal['note'], Literal['warning']]

#: How the shown image is sharpened.
Sharpen = Union[Literal['none'], Literal['normalised'], Literal['rcas'], Literal['xu']]

#: Which work may be left out. Written `off` or `exact`.
Skip = Union[Literal['exact'], Literal['off']]

#: Which colour a recipe resolves.
Source = Union[Literal['color'], Literal['unjittered_if_present']]

#: The colour space of box and rectification.
Space = Union[Literal['rgb'], Literal['ycocg']]

#: How each frame is anti-aliased by itself, before anything else reads its colour.
Spatial = Union[Literal['fxaa'], Literal['none'], Literal['smaa']]

#: Where a job stands.
Status = Union[Literal['cancelled'], Literal['done'], Literal['failed'], Literal['queued'], Literal['running']]

#: How a recipe stood a hazard.
StressVerdict = Union[Literal['degrades'], Literal['fails'], Literal['not_run'], Literal['pass']]

#: Who measured.
SystemKind = Union[Literal['external'], Literal['recipe']]

#: RFC 3339, UTC.
Timestamp = str

#: A difference in the metric's unit, or a share of what is compared with, such as `2 %`.
Tolerance = Union[float, str]

#: A metric and half the width of its mean's 95 % interval, at which a run has seen enough.
Until = str

#: Whether the adapter's results are held against the twin's, pass by pass. Slow: the twin computes in f64 on the CPU.
Validate = Union[Literal['bisect'], Literal['no'], Literal['yes']]

#: A number, or what JSON has none for.
Value = Union[Literal['inf', '-inf', 'nan'], float]

#: What someone said of a result.
Verdict = Union[Literal['approved'], Literal['rejected']]

#: How the weight of the current colour is found.
Weight = Union[Literal['amortized'], Literal['antiflicker'], Literal['count'], Literal['fixed'], Literal['luma_feedback']]



class Problem(Exception):
    """What the service refused: problem details with a stable `code`."""

    def __init__(self, status: int, body: Dict[str, Any]):
        super().__init__(f"{status} {body.get('code', '')}: {body.get('detail', '')}")
        self.status = status
        self.code: str = body.get("code", "")
        self.detail: str = body.get("detail", "")
        self.field: Optional[str] = body.get("field")
        self.body = body


class _Connection(http.client.HTTPConnection):
    """Reads the answer that comes before all was sent: what is refused is not waited for."""

    def request(
        self, method: str, url: str, body: Any = None, headers: Any = {}, *, encode_chunked: bool = False
    ) -> None:
        if self.sock is None:
            self.connect()
        try:
            super().request(method, url, body, headers, encode_chunked=encode_chunked)
        except (BrokenPipeError, ConnectionResetError):
            # Where there is no answer either, reading it fails.
            pass


class _SecureConnection(_Connection, http.client.HTTPSConnection):
    """The same over TLS."""


class _Handler(urllib.request.HTTPHandler, urllib.request.HTTPSHandler):
    def http_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
        return self.do_open(_Connection, request)

    def https_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
        return self.do_open(_SecureConnection, request)


class Client:
    """The service at `url`."""

    def __init__(self, url: str, token: Optional[str] = None, timeout: float = 60.0, attempts: int = 5):
        self.base = url.rstrip("/") + "/api/v1"
        self.token = token
        self.timeout = timeout
        self.attempts = attempts
        self._opener = urllib.request.build_opener(_Handler())

    def _request(self, method: str, path: str, query: Dict[str, Any], headers: Dict[str, Any], body: Any) -> Any:
        pairs = [(name, str(value).lower() if isinstance(value, bool) else value) for name, value in query.items() if value is not None]
        url = self.base + path + ("?" + urllib.parse.urlencode(pairs) if pairs else "")
        sent = {name: str(value) for name, value in headers.items() if value is not None}
        sent.setdefault("Accept", "application/json")
        if self.token:
            sent["Authorization"] = f"Bearer {self.token}"
        data = body
        if body is not None and not isinstance(body, (bytes, bytearray)) and not hasattr(body, "read"):
            data = json.dumps(body, allow_nan=False).encode()
            sent["Content-Type"] = "application/json"
        elif body is not None:
            sent.setdefault("Content-Type", "application/octet-stream")
        if method == "POST":
            sent.setdefault("Idempotency-Key", uuid.uuid4().hex)
        return self._send(urllib.request.Request(url, data=data, headers=sent, method=method))

    def _send(self, request: urllib.request.Request) -> Any:
        # A file is sent again from where it stood, or not at all.
        file: Any = request.data if hasattr(request.data, "read") else None
        attempts = 1 if file and not file.seekable() else self.attempts
        start = file.tell() if file and file.seekable() else 0
        wait = 0.5
        for attempt in range(1, attempts + 1):
            if attempt > 1 and file:
                file.seek(start)
            try:
                with self._opener.open(request, timeout=self.timeout) as answer:
                    content = answer.read()
                    if request.method == "HEAD":
                        offset = answer.headers.get("Upload-Offset")
                        return None if offset is None else int(offset)
                    if "json" in answer.headers.get("Content-Type", ""):
                        return json.loads(content)
                    return content or None
            except urllib.error.HTTPError as error:
                asked = error.headers.get("Retry-After")
                again = error.code == 429 or error.code >= 500 or (error.code == 409 and asked)
                if not again or attempt == attempts:
                    content = error.read()
                    raise Problem(error.code, json.loads(content) if content[:1] == b"{" else {}) from None
                # Proxies may send a date instead of seconds.
                time.sleep(min(float(asked), 60.0) if asked and asked.isdigit() else wait)
            except (urllib.error.URLError, http.client.HTTPException, ConnectionError, TimeoutError):
                if attempt == attempts:
                    raise
                time.sleep(wait)
            wait *= 2

    def upload_blob(self, content: bytes) -> str:
        """Puts a blob, unless it is there, from where an earlier upload stopped; its SHA-256"""
        sha256 = hashlib.sha256(content).hexdigest()
        for attempt in range(1, self.attempts + 1):
            try:
                offset = self.head_blob(sha256)
            except Problem as problem:
                if problem.status != 404:
                    raise
                offset = 0
            if offset is None:
                break
            rest, total = content[offset:], len(content)
            place = f"bytes {offset}-{total - 1}/{total}" if rest else f"bytes */{total}"
            try:
                self.put_blob(sha256, rest, content_range=place if total else None)
                break
            except Problem as problem:
                # A try that broke off left more of it than was known.
                if problem.code != "wrong_offset" or attempt == self.attempts:
                    raise
        return sha256

    def wait_for_job(self, job: int, seconds: float = 3600.0) -> "JobWithReports":
        """A job once it is `done`, `failed` or `cancelled`; `TimeoutError` if it is none of them after so many seconds"""
        end, pause = time.monotonic() + seconds, 0.1
        while True:
            found = self.get_job(job)
            if found["status"] in ("done", "failed", "cancelled"):
                return found
            if time.monotonic() + pause > end:
                raise TimeoutError(f"job {job} is {found['status']} after {seconds} s")
            time.sleep(pause)
            pause = min(2.0, 1.5 * pause)

    def get_adapter(self) -> "AdapterInfo":
        """The adapter that runs jobs"""
        answer: "AdapterInfo" = self._request('GET', f"/adapter", {}, {}, None)
        return answer

    def list_alerts(self, *, branch: Optional[str] = None, cursor: Optional[str] = None, limit: Optional[int] = None, project: Optional[str] = None, since: Optional[str] = None, status: Optional[Union[Literal['dismissed'], Literal['open'], Literal['resolved']]] = None) -> "AlertPage":
        """Faults that were found

        branch: Only of this branch.
        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out.
        project: Only of this project.
        since: Only those whose first bad report is of this commit, or came after it.
        status: Only of this status."""
        answer: "AlertPage" = self._request('GET', f"/alerts", {'branch': branch, 'cursor': cursor, 'limit': limit, 'project': project, 'since': since, 'status': status}, {}, None)
        return answer

    def iterate_alerts(self, **query: Any) -> Iterator["Alert"]:
        """Every row of `list_alerts`, page by page."""
        cursor = None
        while True:
            page = self.list_alerts(cursor=cursor, **query)
            yield from page['alerts']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def get_alert(self, alert: int) -> "Alert":
        """One alert

        alert: Number."""
        answer: "Alert" = self._request('GET', f"/alerts/{urllib.parse.quote(str(alert), safe='')}", {}, {}, None)
        return answer

    def dismiss_alert(self, alert: int, body: "Reason", *, idempotency_key: Optional[str] = None) -> "Alert":
        """Say that an alert does not matter

        alert: Number.
        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Alert" = self._request('POST', f"/alerts/{urllib.parse.quote(str(alert), safe='')}/dismiss", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def list_baselines(self, *, cursor: Optional[str] = None, limit: Optional[int] = None, report: Optional[int] = None, series: Optional[int] = None) -> "DecisionPage":
        """What was approved and rejected, by whom, why

        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out.
        report: Only of this report.
        series: Only of this series."""
        answer: "DecisionPage" = self._request('GET', f"/baselines", {'cursor': cursor, 'limit': limit, 'report': report, 'series': series}, {}, None)
        return answer

    def iterate_baselines(self, **query: Any) -> Iterator["Decision"]:
        """Every row of `list_baselines`, page by page."""
        cursor = None
        while True:
            page = self.list_baselines(cursor=cursor, **query)
            yield from page['decisions']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def list_benchmarks(self, *, cursor: Optional[str] = None, limit: Optional[int] = None, sequence: Optional[str] = None) -> "BenchPage":
        """Benchmarks with their points

        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out.
        sequence: Only those of this sequence: its hash, or the name that it had."""
        answer: "BenchPage" = self._request('GET', f"/bench", {'cursor': cursor, 'limit': limit, 'sequence': sequence}, {}, None)
        return answer

    def iterate_benchmarks(self, **query: Any) -> Iterator["BenchRun"]:
        """Every row of `list_benchmarks`, page by page."""
        cursor = None
        while True:
            page = self.list_benchmarks(cursor=cursor, **query)
            yield from page['runs']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def create_benchmark(self, body: "BenchRequest", *, idempotency_key: Optional[str] = None) -> "Job":
        """Queue a sweep of settings over a sequence

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Job" = self._request('POST', f"/bench", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def get_benchmark(self, job: int) -> "BenchRun":
        """A job's points

        job: Number."""
        answer: "BenchRun" = self._request('GET', f"/bench/{urllib.parse.quote(str(job), safe='')}", {}, {}, None)
        return answer

    def get_front(self, job: int, *, metric: Optional[str] = None) -> bytes:
        """Time against a metric, with the Pareto front

        job: Number.
        metric: What the front is drawn on; the benchmark's own metric where left out."""
        answer: bytes = self._request('GET', f"/bench/{urllib.parse.quote(str(job), safe='')}/front.svg", {'metric': metric}, {}, None)
        return answer

    def export_points(self, job: int, *, metric: Optional[str] = None) -> bytes:
        """A job's points as a table

        job: Number.
        metric: What the front is drawn on; the benchmark's own metric where left out."""
        answer: bytes = self._request('GET', f"/bench/{urllib.parse.quote(str(job), safe='')}/points.csv", {'metric': metric}, {}, None)
        return answer

    def head_blob(self, sha256: str) -> Optional[int]:
        """Whether a file is here, or how much of it

        sha256: SHA-256 of the content in hexadecimal."""
        answer: Optional[int] = self._request('HEAD', f"/blobs/{urllib.parse.quote(str(sha256), safe='')}", {}, {}, None)
        return answer

    def put_blob(self, sha256: str, body: Union[bytes, BinaryIO], *, content_range: Optional[str] = None) -> Union["Blob", None]:
        """Send a file, or the rest of it

        sha256: SHA-256 of the content in hexadecimal.
        content_range: `bytes FIRST-LAST/TOTAL`
        body: The whole file, or the part that `content-range` names."""
        answer: Union["Blob", None] = self._request('PUT', f"/blobs/{urllib.parse.quote(str(sha256), safe='')}", {}, {'Content-Range': content_range}, body)
        return answer

    def list_environments(self) -> "EnvironmentList":
        """Every environment that results came from"""
        answer: "EnvironmentList" = self._request('GET', f"/environments", {}, {}, None)
        return answer

    def get_health(self) -> "Health":
        """Whether the database answers"""
        answer: "Health" = self._request('GET', f"/health", {}, {}, None)
        return answer

    def list_jobs(self, *, cursor: Optional[str] = None, limit: Optional[int] = None, project: Optional[str] = None, sequence: Optional[str] = None, status: Optional[Union[Literal['cancelled'], Literal['done'], Literal['failed'], Literal['queued'], Literal['running']]] = None) -> "JobPage":
        """Jobs

        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out.
        project: Only of this project.
        sequence: Only of this sequence: hash or name.
        status: Only of this status."""
        answer: "JobPage" = self._request('GET', f"/jobs", {'cursor': cursor, 'limit': limit, 'project': project, 'sequence': sequence, 'status': status}, {}, None)
        return answer

    def iterate_jobs(self, **query: Any) -> Iterator["Job"]:
        """Every row of `list_jobs`, page by page."""
        cursor = None
        while True:
            page = self.list_jobs(cursor=cursor, **query)
            yield from page['jobs']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def create_job(self, body: "JobRequest", *, idempotency_key: Optional[str] = None) -> "JobWithReports":
        """Queue presets to run, or images to compare, over a sequence

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "JobWithReports" = self._request('POST', f"/jobs", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def cancel_job(self, job: int) -> "JobWithReports":
        """Cancel a job

        job: Number."""
        answer: "JobWithReports" = self._request('DELETE', f"/jobs/{urllib.parse.quote(str(job), safe='')}", {}, {}, None)
        return answer

    def get_job(self, job: int) -> "JobWithReports":
        """One job with its reports

        job: Number."""
        answer: "JobWithReports" = self._request('GET', f"/jobs/{urllib.parse.quote(str(job), safe='')}", {}, {}, None)
        return answer

    def list_metrics(self) -> List["Listing"]:
        """Every metric that is computed here"""
        answer: List["Listing"] = self._request('GET', f"/metrics", {}, {}, None)
        return answer

    def get_document(self) -> Any:
        """This document"""
        answer: Any = self._request('GET', f"/openapi.json", {}, {}, None)
        return answer

    def list_presets(self) -> List["Preset"]:
        """Published systems with their parameters' values"""
        answer: List["Preset"] = self._request('GET', f"/presets", {}, {}, None)
        return answer

    def list_projects(self) -> "ProjectList":
        """Every project"""
        answer: "ProjectList" = self._request('GET', f"/projects", {}, {}, None)
        return answer

    def list_branches(self, project: str) -> "BranchList":
        """A project's branches with their points of departure

        project: Project name."""
        answer: "BranchList" = self._request('GET', f"/projects/{urllib.parse.quote(str(project), safe='')}/branches", {}, {}, None)
        return answer

    def list_recipes(self) -> "RecipeList":
        """Published systems with every parameter's type, unit, range, default"""
        answer: "RecipeList" = self._request('GET', f"/recipes", {}, {}, None)
        return answer

    def get_recipe(self, preset: str) -> "RecipeListing":
        """One published system

        preset: Preset id."""
        answer: "RecipeListing" = self._request('GET', f"/recipes/{urllib.parse.quote(str(preset), safe='')}", {}, {}, None)
        return answer

    def list_reports(self, *, branch: Optional[str] = None, commit: Optional[str] = None, cursor: Optional[str] = None, latest: Optional[bool] = None, limit: Optional[int] = None, preset: Optional[str] = None, project: Optional[str] = None, sequence: Optional[str] = None, series: Optional[int] = None) -> "ReportPage":
        """Reports

        branch: Only of this branch.
        commit: Only of this commit.
        cursor: The `next_cursor` of the page before.
        latest: Only the newest of each series.
        limit: At most so many, 1 to 1000; 50 where left out.
        preset: Only of this preset or external system.
        project: Only of this project.
        sequence: Only of this sequence: hash or name.
        series: Only of this series."""
        answer: "ReportPage" = self._request('GET', f"/reports", {'branch': branch, 'commit': commit, 'cursor': cursor, 'latest': latest, 'limit': limit, 'preset': preset, 'project': project, 'sequence': sequence, 'series': series}, {}, None)
        return answer

    def iterate_reports(self, **query: Any) -> Iterator["Report"]:
        """Every row of `list_reports`, page by page."""
        cursor = None
        while True:
            page = self.list_reports(cursor=cursor, **query)
            yield from page['reports']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def create_report(self, body: "ReportRequest", *, idempotency_key: Optional[str] = None) -> "Posted":
        """Post results measured elsewhere

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Posted" = self._request('POST', f"/reports", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def create_bencher_reports(self, body: "BencherRequest", *, branch: Optional[str] = None, commit: Optional[str] = None, project: Optional[str] = None, system: Optional[str] = None, testbed: Optional[str] = None, idempotency_key: Optional[str] = None) -> "PostedAll":
        """Post Bencher's metric JSON: a report a benchmark

        branch: Branch.
        commit: Commit.
        project: Project.
        system: What measured; `bencher` where left out.
        testbed: The machine's name.
        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "PostedAll" = self._request('POST', f"/reports/bencher", {'branch': branch, 'commit': commit, 'project': project, 'system': system, 'testbed': testbed}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def get_report(self, report: int) -> "Report":
        """One report without its frames

        report: Number."""
        answer: "Report" = self._request('GET', f"/reports/{urllib.parse.quote(str(report), safe='')}", {}, {}, None)
        return answer

    def close_report(self, report: int, body: "CloseRequest", *, idempotency_key: Optional[str] = None) -> "Posted":
        """Summarise an open report; from now on it counts

        report: Number.
        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Posted" = self._request('POST', f"/reports/{urllib.parse.quote(str(report), safe='')}/close", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def decide(self, report: int, body: "DecisionRequest", *, idempotency_key: Optional[str] = None) -> "Decision":
        """Approve a result into its line's baseline, or reject it

        report: Number.
        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Decision" = self._request('POST', f"/reports/{urllib.parse.quote(str(report), safe='')}/decisions", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    @overload
    def list_frames(self, report: int, *, format: Optional[Literal['json']] = None) -> "FrameList": ...

    @overload
    def list_frames(self, report: int, *, format: Literal['csv', 'parquet']) -> bytes: ...

    def list_frames(self, report: int, *, format: Optional[Union[Literal['csv'], Literal['json'], Literal['parquet']]] = None) -> Union["FrameList", bytes]:
        """Every frame's metrics and times, as JSON, CSV or Parquet

        report: Number.
        format: JSON unless this or the header `accept` asks for another."""
        answer: Union["FrameList", bytes] = self._request('GET', f"/reports/{urllib.parse.quote(str(report), safe='')}/frames", {'format': format}, {}, None)
        return answer

    def add_frames(self, report: int, body: "FramesRequest", *, idempotency_key: Optional[str] = None) -> "FramesPosted":
        """Add frames to an open report

        report: Number.
        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "FramesPosted" = self._request('POST', f"/reports/{urllib.parse.quote(str(report), safe='')}/frames", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def get_report_image(self, report: int, frame: int, image: str, *, max: Optional[float] = None, width: Optional[int] = None) -> bytes:
        """A frame's input, output, reference, error, or map of a spatial metric

        report: Number.
        frame: Frame index, from 0.
        image: `output`, `reference`, `error`, `history`, `skipped` or a spatial metric's id, with `.png` or `.exr`.
        max: The error, in display values, or the value of a map that is drawn white.
        width: Make a PNG at most so wide, 16 to 4096 pixels."""
        answer: bytes = self._request('GET', f"/reports/{urllib.parse.quote(str(report), safe='')}/frames/{urllib.parse.quote(str(frame), safe='')}/{urllib.parse.quote(str(image), safe='')}", {'max': max, 'width': width}, {}, None)
        return answer

    def get_validation(self, report: int) -> "Validation":
        """How far the adapter is from the twin, every pass of every frame

        report: Number."""
        answer: "Validation" = self._request('GET', f"/reports/{urllib.parse.quote(str(report), safe='')}/validation", {}, {}, None)
        return answer

    def list_sequences(self, *, cursor: Optional[str] = None, limit: Optional[int] = None) -> "SequencePage":
        """Sequences

        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out."""
        answer: "SequencePage" = self._request('GET', f"/sequences", {'cursor': cursor, 'limit': limit}, {}, None)
        return answer

    def iterate_sequences(self, **query: Any) -> Iterator["Sequence"]:
        """Every row of `list_sequences`, page by page."""
        cursor = None
        while True:
            page = self.list_sequences(cursor=cursor, **query)
            yield from page['sequences']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def create_sequence(self, body: "SequenceRequest", *, idempotency_key: Optional[str] = None) -> "Sequence":
        """Make a sequence of blobs

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Sequence" = self._request('POST', f"/sequences", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def get_sequence(self, sequence: str) -> "Checked":
        """One sequence with its manifest and its check

        sequence: Content hash, or the name it was last put under."""
        answer: "Checked" = self._request('GET', f"/sequences/{urllib.parse.quote(str(sequence), safe='')}", {}, {}, None)
        return answer

    def put_sequence(self, sequence: str, body: Union[bytes, BinaryIO]) -> "Sequence":
        """Send a sequence as tar, tar.gz or zip

        sequence: Content hash, or the name it was last put under.
        body: Streamed; unpacked within limits, checked and hashed before it is kept."""
        answer: "Sequence" = self._request('PUT', f"/sequences/{urllib.parse.quote(str(sequence), safe='')}", {}, {}, body)
        return answer

    def get_archive(self, sequence: str) -> bytes:
        """A sequence as a tar

        sequence: Content hash, or the name it was last put under."""
        answer: bytes = self._request('GET', f"/sequences/{urllib.parse.quote(str(sequence), safe='')}/archive", {}, {}, None)
        return answer

    def get_sequence_image(self, sequence: str, frame: int, image: str, *, width: Optional[int] = None) -> bytes:
        """A frame's input or reference

        sequence: Content hash, or the name it was last put under.
        frame: Frame index, from 0.
        image: `output`, `reference`, `error`, `history`, `skipped` or a spatial metric's id, with `.png` or `.exr`.
        width: Make a PNG at most so wide, 16 to 4096 pixels."""
        answer: bytes = self._request('GET', f"/sequences/{urllib.parse.quote(str(sequence), safe='')}/frames/{urllib.parse.quote(str(frame), safe='')}/{urllib.parse.quote(str(image), safe='')}", {'width': width}, {}, None)
        return answer

    def list_series(self, metric: str, *, adapter: Optional[str] = None, branch: Optional[str] = None, limit: Optional[int] = None, preset: Optional[str] = None, project: Optional[str] = None, sequence: Optional[str] = None) -> "TrendList":
        """A metric over time, a line for each sequence, recipe and environment

        adapter: Only on adapters of this name.
        branch: Only of this branch, and of its parent up to where it left.
        limit: The newest so many of each series, 1 to 1000; 200 where left out.
        metric: A metric's id, or `gpu_time_ms`.
        preset: Only of this preset or external system.
        project: Only of this project.
        sequence: Only of this sequence: hash or name."""
        answer: "TrendList" = self._request('GET', f"/series", {'adapter': adapter, 'branch': branch, 'limit': limit, 'metric': metric, 'preset': preset, 'project': project, 'sequence': sequence}, {}, None)
        return answer

    def get_series(self, series: int) -> "Series":
        """What the points of a line have in common

        series: Number."""
        answer: "Series" = self._request('GET', f"/series/{urllib.parse.quote(str(series), safe='')}", {}, {}, None)
        return answer

    def get_marks(self, series: int, metric: str, *, branch: Optional[str] = None) -> "Marks":
        """What a chart of a line draws beside its points: limits, baseline, changes of level

        series: Number.
        branch: Of this branch and its past, by its rules; without it, of all reports, by the rules of the newest one's branch.
        metric: A metric's id, or `gpu_time_ms`."""
        answer: "Marks" = self._request('GET', f"/series/{urllib.parse.quote(str(series), safe='')}/marks", {'branch': branch, 'metric': metric}, {}, None)
        return answer

    @overload
    def list_points(self, series: int, metric: str, *, branch: Optional[str] = None, format: Optional[Literal['json']] = None, limit: Optional[int] = None, max_points: Optional[int] = None, since_ms: Optional[int] = None, until_ms: Optional[int] = None) -> "PointList": ...

    @overload
    def list_points(self, series: int, metric: str, *, branch: Optional[str] = None, format: Literal['csv', 'parquet'], limit: Optional[int] = None, max_points: Optional[int] = None, since_ms: Optional[int] = None, until_ms: Optional[int] = None) -> bytes: ...

    def list_points(self, series: int, metric: str, *, branch: Optional[str] = None, format: Optional[Union[Literal['csv'], Literal['json'], Literal['parquet']]] = None, limit: Optional[int] = None, max_points: Optional[int] = None, since_ms: Optional[int] = None, until_ms: Optional[int] = None) -> Union["PointList", bytes]:
        """A metric of one line, whole or thinned, as JSON, CSV or Parquet

        series: Number.
        branch: Only of this branch, and of its parent up to where it left.
        format: JSON unless this or the header `accept` asks for another.
        limit: The newest so many, 1 to 1000000; 100000 where left out.
        max_points: Thin them to at most so many, 4 to 100000, that keep every peak; none are left out without it.
        metric: A metric's id, or `gpu_time_ms`.
        since_ms: Not before: milliseconds since 1970.
        until_ms: Not after: milliseconds since 1970."""
        answer: Union["PointList", bytes] = self._request('GET', f"/series/{urllib.parse.quote(str(series), safe='')}/points", {'branch': branch, 'format': format, 'limit': limit, 'max_points': max_points, 'metric': metric, 'since_ms': since_ms, 'until_ms': until_ms}, {}, None)
        return answer

    def list_matrices(self, *, cursor: Optional[str] = None, limit: Optional[int] = None) -> "StressPage":
        """Matrices of stress runs, without their cells

        cursor: The `next_cursor` of the page before.
        limit: At most so many, 1 to 1000; 50 where left out."""
        answer: "StressPage" = self._request('GET', f"/stress", {'cursor': cursor, 'limit': limit}, {}, None)
        return answer

    def iterate_matrices(self, **query: Any) -> Iterator["StressRun"]:
        """Every row of `list_matrices`, page by page."""
        cursor = None
        while True:
            page = self.list_matrices(cursor=cursor, **query)
            yield from page['runs']
            cursor = page.get('next_cursor')
            if cursor is None:
                return

    def create_matrix(self, body: "StressRequest", *, idempotency_key: Optional[str] = None) -> "Job":
        """Queue a matrix of hazards and recipes

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Job" = self._request('POST', f"/stress", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def get_matrix(self, job: int) -> "Matrix":
        """A job's matrix with its cells

        job: Number."""
        answer: "Matrix" = self._request('GET', f"/stress/{urllib.parse.quote(str(job), safe='')}", {}, {}, None)
        return answer

    def get_cell_image(self, job: int, picture: str) -> bytes:
        """A cell's frames, a row each: adapter, twin, and their difference

        job: Number.
        picture: A cell's index in the matrix, from 0, with `.png`."""
        answer: bytes = self._request('GET', f"/stress/{urllib.parse.quote(str(job), safe='')}/cells/{urllib.parse.quote(str(picture), safe='')}", {}, {}, None)
        return answer

    def list_thresholds(self) -> "ThresholdList":
        """The rules of every branch, as last sent"""
        answer: "ThresholdList" = self._request('GET', f"/thresholds", {}, {}, None)
        return answer

    def list_tokens(self) -> "TokenList":
        """Every token, without its text"""
        answer: "TokenList" = self._request('GET', f"/tokens", {}, {}, None)
        return answer

    def revoke_token(self, token: int) -> None:
        """Revoke a token

        token: Number."""
        self._request('DELETE', f"/tokens/{urllib.parse.quote(str(token), safe='')}", {}, {}, None)

    def create_verdict(self, body: "VerdictRequest", *, idempotency_key: Optional[str] = None) -> "Judgement":
        """Hold reports against rules, which become their branch's

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "Judgement" = self._request('POST', f"/verdicts", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def list_webhooks(self) -> "WebhookList":
        """Every webhook, without its secret"""
        answer: "WebhookList" = self._request('GET', f"/webhooks", {}, {}, None)
        return answer

    def create_webhook(self, body: "WebhookRequest", *, idempotency_key: Optional[str] = None) -> "NewWebhook":
        """Tell an address of a project's verdicts

        idempotency_key: Any text. The same request with the same key is done once; its answer is kept for a day."""
        answer: "NewWebhook" = self._request('POST', f"/webhooks", {}, {'Idempotency-Key': idempotency_key}, body)
        return answer

    def delete_webhook(self, webhook: int) -> None:
        """Remove a webhook

        webhook: Number."""
        self._request('DELETE', f"/webhooks/{urllib.parse.quote(str(webhook), safe='')}", {}, {}, None)

    def list_deliveries(self, webhook: int) -> "DeliveryList":
        """What a webhook was sent

        webhook: Number."""
        answer: "DeliveryList" = self._request('GET', f"/webhooks/{urllib.parse.quote(str(webhook), safe='')}/deliveries", {}, {}, None)
        return answer
