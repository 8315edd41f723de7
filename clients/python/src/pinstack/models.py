"""Types of the JSON documents of the service. Written by ``tools/models.py``; do not edit.

At run time each is a plain ``dict``: members that a newer service adds are kept.
"""

from __future__ import annotations

from typing import Any, Dict, List, Literal, Optional, TypedDict

from typing_extensions import NotRequired


ActionKind = Literal["fuse_again", "calibrate", "delete"]


CalibrationSource = Literal["dot_target", "stacks"]


CaptureMode = Literal["fixed_lens", "moving_lens", "lens_alone"]


Code = Literal["invalid_request", "unauthorized", "forbidden", "cross_origin_request", "misdirected_request", "too_many_requests", "not_found", "method_not_allowed", "method_not_implemented", "profile_not_found", "scan_not_found", "scan_mismatch", "not_finished", "no_result", "upload_removed", "conflict", "precondition_failed", "idempotency_key_reused", "unsupported_media_type", "not_acceptable", "range_not_satisfiable", "upload_too_large", "upload_incomplete", "checksum_mismatch", "locked", "insufficient_storage", "queue_full", "invalid_archive", "unsupported_archive", "archive_too_large", "invalid_image", "size_mismatch", "slice_count_mismatch", "invalid_profile", "invalid_poses", "target_not_found", "mask_failed", "reconstruction_failed", "worker_lost", "unavailable", "internal"]


Grade = Literal["good", "usable", "poor"]


HeightDirection = Literal["towards_camera", "with_slice_number"]


HeightMode = Literal["none", "auto"]


HeightUnit = Literal["mm", "rail_mm", "steps"]


Homography = List[float]


HomographyModel = Literal["rail_linear", "rail_shifts", "similarity", "affine", "homography", "rig_parameters", "given"]


ImageFormat = Literal["png", "tiff", "jpeg"]


JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]


Keep = Literal["always", "usable", "good"]


LateralColourMode = Literal["correct", "keep"]


LengthUnit = Literal["mm", "radius"]


MaskEdge = Literal["hard", "soft"]


MaskMode = Literal["auto", "none", "required"]


Method = Literal["guided", "pyramid", "halo_corrected"]


ModelChoice = Literal["auto", "rail_linear", "similarity", "affine", "homography"]


Name = str


OutlierKind = Literal["sharpness", "mask_area", "residual", "exposure"]


PanDirection = Literal["counterclockwise", "clockwise"]


PoseFormat = Literal["colmap_text", "colmap_binary", "alicevision", "metashape", "openmvg", "csv"]


PrincipalDistanceSource = Literal["camera_rail", "moved_target", "pupil_ratio", "focal_length", "unknown"]


Priority = Literal["high", "normal", "low"]


ProfileSource = Literal["upload", "calibration"]


Reconstruct = Literal["on_request", "auto"]


ScaleSource = Literal["none", "known_radius", "view_pair"]


Severity = Literal["warning", "note"]


SliceOrder = Literal["name", "reverse"]


SurfaceKind = Literal["sphere", "circle"]


UnderAlpha = Literal["black", "keep", "pad"]


UploadProgress = Literal["receiving", "complete", "refused"]


UploadPurpose = Literal["stack", "calibration", "scan"]


Verdict = Literal["use", "look", "do_not_use"]


class Action(TypedDict):
    """A request that does what a finding needs."""

    href: str
    kind: ActionKind
    label: str
    method: str
    options: NotRequired[Optional[Dict[str, Any]]]


class Advice(TypedDict):
    """A warning or note of a stack: what happened, what to do, and what the service can do about it."""

    actions: List[Action]
    code: str
    cure: str
    detail: str
    slices: List[int]
    title: str
    verdict: Verdict


class AlignmentMetrics(TypedDict):
    """Residual shifts between neighbouring warped slices, which show whether the profile fits the stack."""

    common_fraction: NotRequired[Optional[float]]
    residual_p50_px: NotRequired[Optional[float]]
    residual_p95_px: NotRequired[Optional[float]]
    residual_scale: NotRequired[Optional[float]]
    similarity: NotRequired[Optional[ResidualSimilarity]]


class ArchivedView(TypedDict):
    """A view in the zip of a scan."""

    back: int
    folder: str
    front: int
    label: NotRequired[Optional[str]]
    pan_deg: NotRequired[Optional[float]]
    problem: NotRequired[Optional[str]]
    slices: List[str]
    stack: NotRequired[Optional[str]]
    tilt_deg: NotRequired[Optional[float]]


class ArtifactView(TypedDict):
    """A result file of a job."""

    bytes: int
    href: str
    media_type: str
    name: str
    sha256: str


class JobView(TypedDict):
    """State and progress of a stack, a calibration or a reconstruction."""

    attempt: int
    cancel_requested: bool
    created_at: str
    error: NotRequired[Optional[Problem]]
    finished_at: NotRequired[Optional[str]]
    id: str
    lens: Name
    progress: Progress
    rig: Name
    started_at: NotRequired[Optional[str]]
    state: JobState
    upload: UploadView
    warnings: List[Warning]


class Calibration(JobView):
    """A dot target, or stacks, and the profile that was measured from them."""

    artifacts: List[ArtifactView]
    links: CalibrationLinks
    options: CalibrationOptions
    result: NotRequired[Optional[CalibrationResult]]
    slices: StackLayout
    stacks: List[str]


class CalibrationLinks(TypedDict):
    """URLs of a calibration."""

    cancel: NotRequired[Optional[str]]
    events: str
    overlay: NotRequired[Optional[str]]
    profile: NotRequired[Optional[str]]
    report: NotRequired[Optional[str]]
    self: str


class CalibrationOptions(TypedDict):
    """Options of a calibration."""

    allow_new_size: NotRequired[bool]
    capture_mode: NotRequired[Optional[CaptureMode]]
    focal_mm: NotRequired[Optional[float]]
    # from: NotRequired[Optional[int]]
    keep: NotRequired[Keep]
    model: NotRequired[ModelChoice]
    moved_target: NotRequired[Optional[str]]
    moved_target_pitch_px: NotRequired[Optional[float]]
    note: NotRequired[Optional[str]]
    pixel_pitch_mm: NotRequired[Optional[float]]
    pupil_ratio: NotRequired[Optional[float]]
    rail_positions_mm: NotRequired[Optional[List[float]]]
    rail_step_mm: NotRequired[Optional[float]]
    reference_index: NotRequired[Optional[int]]
    source: NotRequired[CalibrationSource]
    target_advance_mm: NotRequired[Optional[float]]
    target_pitch_mm: NotRequired[Optional[float]]


class CalibrationResult(TypedDict):
    """What a calibration measured."""

    dot_pitch_px: NotRequired[Optional[float]]
    grade: NotRequired[Optional[Grade]]
    magnification: NotRequired[Optional[float]]
    profile_digest: NotRequired[Optional[str]]
    profile_optics_digest: NotRequired[Optional[str]]
    profile_revision: NotRequired[Optional[int]]
    reference_index: int
    slices: List[ProfileSlice]
    verdict: str


class ColourDisplacement(TypedDict):
    """Displacement of a colour relative to green."""

    scale: float
    shift_px: NotRequired[List[float]]


class Distortion(TypedDict):
    """Radial distortion of the pixels of every slice, the same for all slices."""

    centre_px: List[float]
    k1: float
    k2: NotRequired[float]
    radius_px: float


class ErrorLocation(TypedDict):
    """The location of an error: a field, a file or a slice."""

    detail: str
    file: NotRequired[Optional[str]]
    pointer: NotRequired[Optional[str]]
    slice: NotRequired[Optional[int]]


class Finding(TypedDict):
    """One diagnosis of a stack."""

    code: str
    detail: str
    severity: Severity
    slices: NotRequired[List[int]]


class FocalLengthReport(TypedDict):
    """The focal length of a reconstruction against the principal distance of the camera."""

    camera_px: float
    camera_sigma_px: NotRequired[Optional[float]]
    difference_percent: float
    reconstruction_px: float
    reconstruction_sigma_px: NotRequired[Optional[float]]


class FocusMetrics(TypedDict):
    """Coverage in depth."""

    ambiguity: NotRequired[Optional[float]]
    coverage_gaps: List[int]
    label_noise: NotRequired[Optional[float]]
    order: NotRequired[Optional[List[int]]]
    peak_at_first_fraction: NotRequired[Optional[float]]
    peak_at_last_fraction: NotRequired[Optional[float]]
    range_too_short_far: NotRequired[Optional[bool]]
    range_too_short_near: NotRequired[Optional[bool]]
    redundant_slices: List[int]
    textured_fraction: NotRequired[Optional[float]]
    uneven_steps: NotRequired[List[int]]
    unfocused_area: NotRequired[Optional[UnfocusedArea]]
    unfocused_fraction: NotRequired[Optional[float]]


class FormatsInfo(TypedDict):
    """Formats that the service reads and writes."""

    bit_depths: List[int]
    images: List[str]
    slices: List[str]
    uploads: List[str]


class FurtherLight(TypedDict):
    """A further light of a stack: the same view, taken again at the same rail positions under another light."""

    name: str
    slices: List[str]


class FusionMetrics(TypedDict):
    """Quality of the fused image, measured on luma 0..255 (16-bit slices are scaled) over valid pixels, and over the object alone when there is a mask."""

    clipped_fraction: NotRequired[Optional[float]]
    laplacian_variance: NotRequired[Optional[float]]
    mean_level: NotRequired[Optional[float]]
    overshoot_fraction: NotRequired[Optional[float]]
    overshoot_levels: NotRequired[Optional[float]]
    q_g_top: NotRequired[Optional[float]]
    q_w_top: NotRequired[Optional[float]]
    sharpness_retention: NotRequired[Optional[float]]
    spatial_frequency: NotRequired[Optional[float]]
    tenengrad: NotRequired[Optional[float]]


class HeightInfo(TypedDict):
    """How to read a height map."""

    direction: HeightDirection
    invalid: int
    median_sigma: NotRequired[Optional[float]]
    offset: float
    scale: float
    unit: HeightUnit
    valid_fraction: float


class IgnoredFile(TypedDict):
    """A file that belongs to no view."""

    name: str
    reason: str


class ImageDistortion(TypedDict):
    """Radial distortion in the convention of OpenCV and COLMAP: with `x` and `y` relative to the centre and divided by `principal_distance_px`, and `r^2 = x^2 + y^2`, the distorted point is `(x, y) (1 + k1 r^2 + k2 r^4)`."""

    centre_px: List[float]
    k1: float
    k2: float


class ImageInfo(TypedDict):
    """Properties of the fused image."""

    bit_depth: int
    crop_offset_px: List[int]
    height: int
    intrinsics: NotRequired[Optional[Intrinsics]]
    width: int


class Info(TypedDict):
    """The service: version, limits, formats, defaults."""

    defaults: StackOptions
    formats: FormatsInfo
    id: str
    limits: LimitsInfo
    name: str
    version: str
    workers: int


class Intrinsics(TypedDict):
    """Intrinsics of the image, from the profile."""

    distortion: NotRequired[Optional[ImageDistortion]]
    pixel_pitch_mm: float
    principal_distance_mm: float
    principal_distance_px: float
    principal_distance_sigma_mm: NotRequired[Optional[float]]
    principal_point_px: NotRequired[Optional[List[float]]]


class KnownLengthReport(TypedDict):
    """A known length of the object against the reconstruction, whose scale comes from the cameras."""

    difference_percent: float
    known_mm: float
    reconstruction_mm: float


class LateralColour(TypedDict):
    """Where red and blue light falls relative to green light; the same in every slice."""

    blue: ColourDisplacement
    red: ColourDisplacement


class LightMetrics(TypedDict):
    """Metrics of a further light."""

    alignment: AlignmentMetrics
    name: str


class LimitsInfo(TypedDict):
    """Limits of the service."""

    body_idle_timeout_s: float
    max_archive_members: int
    max_member_bytes: int
    max_pixels: int
    max_scan_bytes: int
    max_slices: int
    max_unpacked_bytes: int
    max_upload_bytes: int
    max_wait_s: int
    queue_limit: int
    upload_keep_s: int


class MaskMetrics(TypedDict):
    """Metrics of the mask."""

    border_contact_fraction: float
    components: int
    foreground_fraction: float
    holes: int
    light_falloff: NotRequired[Optional[float]]
    separability: NotRequired[Optional[float]]
    threshold: float
    translucent_fraction: NotRequired[float]


class Metrics(TypedDict):
    """The quality metrics of a stack."""

    alignment: AlignmentMetrics
    findings: NotRequired[List[Finding]]
    focus: FocusMetrics
    fusion: FusionMetrics
    lights: NotRequired[List[LightMetrics]]
    mask: NotRequired[Optional[MaskMetrics]]
    slices: List[SliceMetrics]
    timing_ms: Timing
    versions: NotRequired[List[str]]


class NameGrouping(TypedDict):
    """The views that names tell."""

    ignored: List[IgnoredFile]
    stack: NotRequired[NamedStack]
    views: List[NamedView]
    warnings: List[Warning]


class NamedStack(TypedDict):
    """One stack as names tell it."""

    back: List[str]
    front: List[str]
    gaps: NotRequired[Optional[str]]
    lights: List[FurtherLight]
    moved: List[str]
    problem: NotRequired[Optional[str]]


class NamedView(TypedDict):
    """A view that names tell."""

    back: List[str]
    front: List[str]
    gaps: NotRequired[Optional[str]]
    name: str
    pan_deg: NotRequired[Optional[float]]
    problem: NotRequired[Optional[str]]
    tilt_deg: NotRequired[Optional[float]]


class Note(TypedDict):
    """A note about a stack, a scan or a profile."""

    author: NotRequired[Optional[Name]]
    created_at: str
    id: str
    text: str


class PoseReport(TypedDict):
    """How well the poses of a scan fit a turntable."""

    axis: NotRequired[Optional[List[float]]]
    duplicates: List[str]
    expected: NotRequired[Optional[int]]
    findings: List[Warning]
    focal_length: NotRequired[Optional[FocalLengthReport]]
    format: PoseFormat
    known_length: NotRequired[Optional[KnownLengthReport]]
    not_checked: NotRequired[Optional[str]]
    not_registered: List[str]
    pan_is_clockwise: NotRequired[Optional[bool]]
    pan_steps: NotRequired[Optional[StepReport]]
    pan_steps_of_axes: NotRequired[Optional[StepReport]]
    registered: int
    scale: ScaleReport
    surface: NotRequired[Optional[SurfaceReport]]
    tilt_steps: NotRequired[Optional[StepReport]]
    tilt_steps_of_axes: NotRequired[Optional[StepReport]]
    unknown: List[str]
    views: List[ViewPose]


class Problem(TypedDict):
    """An error as in error answers and failed jobs (RFC 9457, `application/problem+json`)."""

    code: Code
    detail: str
    errors: NotRequired[List[ErrorLocation]]
    instance: NotRequired[Optional[str]]
    status: int
    title: str
    type: str


class Pupils(TypedDict):
    """The pupils of the lens at the reference slice; null where unknown."""

    entrance_pupil_distance_mm: NotRequired[Optional[float]]
    entrance_pupil_distance_sigma_mm: NotRequired[Optional[float]]
    exit_pupil_distance_mm: NotRequired[Optional[float]]
    exit_pupil_distance_sigma_mm: NotRequired[Optional[float]]
    principal_distance_sigma_mm: NotRequired[Optional[float]]
    pupil_ratio: NotRequired[Optional[float]]
    pupil_ratio_sigma: NotRequired[Optional[float]]


class ProfileInput(Pupils):
    """Body of `PUT /v1/profiles/{rig}/{lens}`: homographies measured elsewhere."""

    capture_mode: NotRequired[Optional[CaptureMode]]
    distortion: NotRequired[Optional[Distortion]]
    gains: NotRequired[Optional[List[float]]]
    homographies: List[Homography]
    image_height: int
    image_width: int
    lateral_colour: NotRequired[Optional[LateralColour]]
    magnification: NotRequired[Optional[float]]
    note: NotRequired[Optional[str]]
    orientation: NotRequired[Optional[int]]
    pixel_pitch_mm: NotRequired[Optional[float]]
    principal_distance_mm: NotRequired[Optional[float]]
    principal_distance_source: NotRequired[Optional[PrincipalDistanceSource]]
    principal_point_px: NotRequired[Optional[List[float]]]
    rail_positions_mm: NotRequired[Optional[List[float]]]
    reference_index: int


class Profile(ProfileInput):
    """A calibration profile at one revision."""

    calibration_id: NotRequired[Optional[str]]
    created_at: str
    digest: str
    lens: Name
    model: HomographyModel
    optics_digest: NotRequired[str]
    origin: NotRequired[Optional[ProfileOrigin]]
    principal_distance_px: NotRequired[Optional[float]]
    revision: int
    rig: Name
    slice_count: int
    slices: List[ProfileSlice]
    source: ProfileSource
    warnings: NotRequired[List[Warning]]


class ProfileOrigin(TypedDict):
    """The profile of another server, or of another name, that was exported and imported here."""

    calibration_id: NotRequired[Optional[str]]
    created_at: str
    digest: str
    lens: Name
    revision: int
    rig: Name


class ProfileSlice(TypedDict):
    """One slice of a profile."""

    corner_sigma_px: NotRequired[Optional[float]]
    dots_found: NotRequired[Optional[int]]
    gain: float
    homography: Homography
    index: int
    inliers: NotRequired[Optional[int]]
    interpolated: bool
    p95_px: NotRequired[Optional[float]]
    rms_px: NotRequired[Optional[float]]
    scale: float
    shift_px: List[float]


class ProfileSummary(Pupils):
    """A calibration profile at one revision, without its data per slice (`homographies`, `gains`, `rail_positions_mm` and `slices`)."""

    calibration_id: NotRequired[Optional[str]]
    capture_mode: NotRequired[Optional[CaptureMode]]
    created_at: str
    digest: str
    image_height: int
    image_width: int
    lens: Name
    magnification: NotRequired[Optional[float]]
    model: HomographyModel
    note: NotRequired[Optional[str]]
    optics_digest: NotRequired[str]
    origin: NotRequired[Optional[ProfileOrigin]]
    pixel_pitch_mm: NotRequired[Optional[float]]
    principal_distance_mm: NotRequired[Optional[float]]
    principal_distance_px: NotRequired[Optional[float]]
    principal_distance_source: NotRequired[Optional[PrincipalDistanceSource]]
    principal_point_px: NotRequired[Optional[List[float]]]
    reference_index: int
    revision: int
    rig: Name
    slice_count: int
    source: ProfileSource
    warnings: NotRequired[List[Warning]]


class Progress(TypedDict):
    """Progress of a job."""

    completed: int
    fraction: float
    stage: str
    total: int


class ReconstructedHull(TypedDict):
    """Figures of the visual hull, in `unit` (areas in its square, volumes in its cube)."""

    area: float
    cell: float
    left_out: List[str]
    size: List[float]
    triangles: int
    volume: float


class ReconstructedView(TypedDict):
    """A view of a reconstruction."""

    features: NotRequired[Optional[int]]
    mean_error_px: NotRequired[Optional[float]]
    name: str
    points: NotRequired[Optional[int]]
    radial: NotRequired[Optional[float]]
    registered: bool
    stack: str
    tangential: NotRequired[Optional[float]]


class Reconstruction(JobView):
    """A reconstruction of the views of a scan."""

    artifacts: List[ArtifactView]
    links: ReconstructionLinks
    options: ReconstructionOptions
    result: NotRequired[Optional[ReconstructionResult]]
    scan: Name


class ReconstructionFinding(TypedDict):
    """Something conspicuous about a reconstruction."""

    code: str
    detail: str
    views: List[str]


class ReconstructionLinks(TypedDict):
    """URLs of a reconstruction."""

    cameras: NotRequired[Optional[str]]
    cancel: NotRequired[Optional[str]]
    events: str
    hull: NotRequired[Optional[str]]
    log: NotRequired[Optional[str]]
    mesh: NotRequired[Optional[str]]
    model: NotRequired[Optional[str]]
    points: NotRequired[Optional[str]]
    poses: NotRequired[Optional[str]]
    scan: str
    self: str


class ReconstructionOptions(TypedDict):
    """Options of a reconstruction."""

    max_error_px: NotRequired[float]
    partial: NotRequired[bool]


class ReconstructionResult(TypedDict):
    """What a reconstruction found."""

    expected: int
    findings: List[ReconstructionFinding]
    focal_px: NotRequired[Optional[float]]
    hull: NotRequired[Optional[ReconstructedHull]]
    mean_error_px: NotRequired[Optional[float]]
    observations: int
    points: int
    program: str
    registered: int
    unit: NotRequired[Optional[LengthUnit]]
    views: List[ReconstructedView]


class RerunOptions(TypedDict):
    """Options of a rerun."""

    average: NotRequired[Optional[int]]
    bit_depth: NotRequired[Optional[str]]
    crop: NotRequired[Optional[str]]
    eps1: NotRequired[Optional[float]]
    eps2: NotRequired[Optional[float]]
    format: NotRequired[Optional[ImageFormat]]
    height: NotRequired[Optional[HeightMode]]
    input_bits: NotRequired[Optional[str]]
    jpeg_quality: NotRequired[Optional[int]]
    keep_days: NotRequired[Optional[int]]
    label: NotRequired[Optional[str]]
    lateral_colour: NotRequired[Optional[LateralColourMode]]
    mask: NotRequired[Optional[MaskMode]]
    mask_edge: NotRequired[Optional[MaskEdge]]
    mask_min_blob_px: NotRequired[Optional[int]]
    mask_min_hole_px: NotRequired[Optional[int]]
    mask_threshold: NotRequired[Optional[str]]
    method: NotRequired[Optional[Method]]
    order: NotRequired[Optional[SliceOrder]]
    pan_deg: NotRequired[Optional[float]]
    priority: NotRequired[Optional[Priority]]
    profile_revision: NotRequired[Optional[int]]
    r1: NotRequired[Optional[int]]
    r2: NotRequired[Optional[int]]
    r_g: NotRequired[Optional[int]]
    scan: NotRequired[Optional[Name]]
    sigma_g: NotRequired[Optional[float]]
    tilt_deg: NotRequired[Optional[float]]
    under_alpha: NotRequired[Optional[UnderAlpha]]


class RerunView(TypedDict):
    """A view that is fused again."""

    name: str
    rerun_of: str
    stack: str


class ResidualSimilarity(TypedDict):
    """Residual shift, scale and rotation per step from slice to slice: none, if the profile fits."""

    corner_drift_px: float
    corner_drift_sigma_px: float
    rotation_deg: float
    scale: float
    shift_px: List[float]
    shifts: int


class ResumableUpload(TypedDict):
    """A resumable upload."""

    created_at: str
    error: NotRequired[Optional[Problem]]
    expires_at: str
    filename: NotRequired[Optional[str]]
    id: str
    job: NotRequired[Optional[str]]
    length: int
    metadata: Dict[str, str]
    offset: int
    purpose: UploadPurpose
    state: UploadProgress


class ScaleReport(TypedDict):
    """The scale of a reconstruction."""

    per_file_unit: float
    source: ScaleSource
    unit: LengthUnit


class ScanInput(TypedDict):
    """Body of `PUT /v1/scans/{scan}`."""

    expected_views: NotRequired[Optional[int]]
    lens: Name
    metadata: NotRequired[Dict[str, str]]
    note: NotRequired[Optional[str]]
    operator: NotRequired[Optional[str]]
    pan_direction: NotRequired[PanDirection]
    radius_mm: NotRequired[Optional[float]]
    reconstruct: NotRequired[Reconstruct]
    rig: Name
    specimen: NotRequired[Optional[str]]
    taxon: NotRequired[Optional[str]]


class Scan(ScanInput):
    """A stored scan."""

    created_at: str
    name: Name
    updated_at: str
    version: int


class ScanArchiveView(TypedDict):
    """The views that were found in the zip of a scan."""

    ignored: List[IgnoredFile]
    scan: Name
    views: List[ArchivedView]
    warnings: List[Warning]


class ScanFinding(TypedDict):
    """Something conspicuous about a scan."""

    code: str
    detail: str
    views: List[str]


class ScanLinks(TypedDict):
    """URLs of a scan."""

    archive: str
    bundle: str
    profile: str
    rerun: str
    self: str
    stacks: str
    views_csv: str


class ScanRerun(TypedDict):
    """The new stacks of a scan."""

    scan: Name
    skipped: List[SkippedView]
    views: List[RerunView]


class ScanSummary(TypedDict):
    """The views of a scan by number and state."""

    expected: NotRequired[Optional[int]]
    failed: int
    queued: int
    replaced: int
    running: int
    succeeded: int
    views: int


class ScanView(TypedDict):
    """A view of a scan."""

    border_contact: NotRequired[Optional[float]]
    error: NotRequired[Optional[Problem]]
    findings: List[str]
    image_size_px: NotRequired[Optional[List[int]]]
    label: NotRequired[Optional[str]]
    mask_area: NotRequired[Optional[float]]
    mean_level: NotRequired[Optional[float]]
    name: str
    outliers: List[ViewOutlier]
    pan_deg: NotRequired[Optional[float]]
    profile_revision: int
    progress: float
    replaced: List[str]
    residual_px: NotRequired[Optional[float]]
    sharpness: NotRequired[Optional[float]]
    stack: str
    state: JobState
    tilt_deg: NotRequired[Optional[float]]
    unfocused_fraction: NotRequired[Optional[float]]
    verdict: NotRequired[Optional[Verdict]]


class ScanWithViews(Scan):
    """A scan with its views."""

    findings: List[ScanFinding]
    links: ScanLinks
    missing: List[ViewAngles]
    summary: ScanSummary
    views: List[ScanView]


class SkippedView(TypedDict):
    """A view that is not fused again."""

    detail: str
    name: str
    stack: str


class SliceMetrics(TypedDict):
    """Metrics of one slice."""

    balance_ratio: NotRequired[Optional[List[float]]]
    clipped_fraction: NotRequired[Optional[float]]
    contribution: NotRequired[Optional[float]]
    duplicate_of: NotRequired[Optional[int]]
    exposure_ratio: NotRequired[Optional[float]]
    flicker_ratio: NotRequired[Optional[float]]
    index: int
    name: str
    residual_px: NotRequired[Optional[float]]
    sharpness: NotRequired[Optional[float]]
    valid_fraction: NotRequired[Optional[float]]


class Stack(JobView):
    """A focus stack and its results."""

    advice: List[Advice]
    artifacts: List[ArtifactView]
    height: NotRequired[Optional[HeightInfo]]
    image: NotRequired[Optional[ImageInfo]]
    links: StackLinks
    metrics: NotRequired[Optional[Metrics]]
    options: StackOptions
    profile_digest: str
    profile_optics_digest: NotRequired[Optional[str]]
    profile_revision: int
    rerun_of: NotRequired[Optional[str]]
    slices: StackLayout
    software: NotRequired[Optional[str]]
    verdict: NotRequired[Optional[Verdict]]


class StackLayout(TypedDict):
    """The ordered slices of an archive, and their common properties."""

    back: List[str]
    bit_depth: int
    channels: int
    front: List[str]
    height: int
    largest_file_bytes: NotRequired[int]
    lights: NotRequired[List[FurtherLight]]
    moved: NotRequired[List[str]]
    orientation: NotRequired[int]
    width: int


class StackLinks(TypedDict):
    """URLs of a stack."""

    backlight: NotRequired[Optional[str]]
    cancel: NotRequired[Optional[str]]
    depth: NotRequired[Optional[str]]
    events: str
    height: NotRequired[Optional[str]]
    height_sigma: NotRequired[Optional[str]]
    image: NotRequired[Optional[str]]
    lights: NotRequired[Dict[str, str]]
    mask: NotRequired[Optional[str]]
    metrics: NotRequired[Optional[str]]
    preview: NotRequired[Optional[str]]
    profile: str
    rerun: NotRequired[Optional[str]]
    self: str
    upload: NotRequired[Optional[str]]


class StackOptions(TypedDict):
    """Every option of a stack as it was used, with defaults filled in."""

    average: int
    bit_depth: str
    crop: str
    eps1: float
    eps2: float
    format: ImageFormat
    height: HeightMode
    input_bits: str
    jpeg_quality: int
    keep_days: Optional[int]
    label: Optional[str]
    lateral_colour: LateralColourMode
    mask: MaskMode
    mask_edge: MaskEdge
    mask_min_blob_px: Optional[int]
    mask_min_hole_px: Optional[int]
    mask_threshold: str
    method: Method
    order: SliceOrder
    pan_deg: Optional[float]
    priority: Priority
    profile_revision: Optional[int]
    r1: int
    r2: int
    r_g: int
    scan: Optional[Name]
    sigma_g: float
    tilt_deg: Optional[float]
    under_alpha: UnderAlpha


class StackOptionsInput(TypedDict):
    """Options of a stack."""

    average: NotRequired[int]
    bit_depth: NotRequired[str]
    crop: NotRequired[str]
    eps1: NotRequired[float]
    eps2: NotRequired[float]
    format: NotRequired[ImageFormat]
    height: NotRequired[HeightMode]
    input_bits: NotRequired[str]
    jpeg_quality: NotRequired[int]
    keep_days: NotRequired[Optional[int]]
    label: NotRequired[Optional[str]]
    lateral_colour: NotRequired[LateralColourMode]
    mask: NotRequired[MaskMode]
    mask_edge: NotRequired[MaskEdge]
    mask_min_blob_px: NotRequired[Optional[int]]
    mask_min_hole_px: NotRequired[Optional[int]]
    mask_threshold: NotRequired[str]
    method: NotRequired[Method]
    order: NotRequired[SliceOrder]
    pan_deg: NotRequired[Optional[float]]
    priority: NotRequired[Priority]
    profile_revision: NotRequired[Optional[int]]
    r1: NotRequired[int]
    r2: NotRequired[int]
    r_g: NotRequired[int]
    scan: NotRequired[Optional[Name]]
    sigma_g: NotRequired[float]
    tilt_deg: NotRequired[Optional[float]]
    under_alpha: NotRequired[UnderAlpha]


class StackTotals(TypedDict):
    """Numbers of stacks."""

    do_not_use: int
    failed: int
    look: int
    stacks: int
    use: int


class StageTime(TypedDict):
    """Processing time of one stage."""

    ms: int
    stage: str


class StepReport(TypedDict):
    """Steps of the turntable between commanded neighbours."""

    commanded_deg: float
    count: int
    mean_deg: float
    std_deg: float


class SurfaceReport(TypedDict):
    """The fitted sphere or circle."""

    centre: List[float]
    kind: SurfaceKind
    max: float
    mean_radius: float
    radius: float
    rejected: int
    rms: float
    std: float
    std_percent: float
    std_population: float
    used: int


class Timing(TypedDict):
    """Processing time, milliseconds of wall clock."""

    stages: NotRequired[List[StageTime]]
    total: int


class UnfocusedArea(TypedDict):
    """An area of the object without texture: smooth, or never in focus."""

    fraction: float
    height: int
    width: int
    x: int
    y: int


class UploadView(TypedDict):
    """The zip as it was sent."""

    bytes: int
    filename: NotRequired[Optional[str]]
    removed: NotRequired[bool]
    sha256: str


class ViewAngles(TypedDict):
    """Pan and tilt of a view, degrees."""

    pan_deg: float
    tilt_deg: float


class ViewOutlier(TypedDict):
    """A quantity in which a view differs from its neighbours."""

    detail: str
    expected: float
    kind: OutlierKind
    value: float


class ViewPose(TypedDict):
    """A registered view."""

    commanded_pan_deg: NotRequired[Optional[float]]
    commanded_tilt_deg: NotRequired[Optional[float]]
    is_outlier: bool
    name: str
    pan_deg: NotRequired[Optional[float]]
    pan_residual_deg: NotRequired[Optional[float]]
    radial_residual: NotRequired[Optional[float]]
    tangential_residual: NotRequired[Optional[float]]
    tilt_deg: NotRequired[Optional[float]]
    tilt_residual_deg: NotRequired[Optional[float]]


class Warning(TypedDict):
    """An observation for the user that did not stop the work."""

    code: str
    detail: str
