"""What the name of an array says: which part of an FRF or of a time history it is, of which channel, in which unit."""

import re
from dataclasses import dataclass

from vibrecords.frf_set import Quantity

#: Names by which each array is known, the one we write first; compared without regard to case.
ALIASES: dict[str, tuple[str, ...]] = {
    "frequency_hz": ("frequency_hz", "frequency", "frequencies", "freq", "freqs", "freq_hz", "f_hz", "f", "ff"),
    "omega": ("omega_rad_s", "omega"),
    "frf": ("frf", "h", "frfs"),
    "outputs": ("outputs", "output", "responses", "response_channels"),
    "inputs": ("inputs", "input", "references", "reference_channels"),
    "quantity": ("quantity",),
    "unit": ("unit", "units"),
    "coherence": ("coherence", "coh", "gamma2"),
    "averages": ("averages", "n_averages", "navg"),
    "sample_rate_hz": ("sample_rate_hz", "sample_rate", "fs"),
    "time": ("time", "time_s", "t"),
    "samples": ("samples",),
    "channels": ("channels", "channel"),
    "quantities": ("quantities",),
    "hits": ("hits",),
}
#: Time histories that stand under the name of what was measured.
SENSORS = ("force", "displacement", "velocity", "acceleration", "response")
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_FREQUENCY = _words("freq freqs frequency frequencies frq frequenz frequence fréquence hz khz")
_SAMPLING, _START = _words("sample samples sampling samp"), _words("start min first begin 0")
_STEP = _words("df step res resolution inc increment delta spacing")
_LIMIT = _words("max end stop upper lower last center centre cutoff limit limits stamp zone")
_QUANTITIES: dict[Quantity, frozenset[str]] = {
    "receptance": _words("recep receptance receptances compliance admittance"),
    "mobility": _words("mob mobility mobilities"),
    "accelerance": _words("accelerance accelerances inertance"),
}
_BESIDE_F = _words("f axis vec vector hz khz rad s") | _START | _STEP
#: Words of an FRF wherever they stand in a name, and those that count only at its beginning.
_FRF = _words("frf frfs transfer txy hxy").union(*_QUANTITIES.values())
_FRF_FIRST = _words("h hf hv tf")
#: Words that tell the role wherever they stand in a name; the first role that fits is taken.
_ROLES: tuple[tuple[str, frozenset[str]], ...] = (
    ("meta", _words("unit units label labels names title comment date index idx nat natural mode modes damping")),
    ("coherence", _words("coherence coh cxy msc kohärenz gamma")),
    (
        "spectrum",
        _words(
            "psd asd csd fft spec spectrum spectra autospectrum autopower cross rms gxx gyy gxy gff gxf pxx pyy pxy"
        ),
    ),
    ("phase", _words("phase phs phi angle ang arg")),
    ("magnitude", _words("mag magnitude amp ampl amplitude abs modulus betrag db")),
    ("imaginary", _words("imag im imaginary")),
    ("real", _words("real re")),
)
_SIGNAL = _words(
    "x y u acc accel acceleration force hammer resp response signal signals data values ch chan channel ai input "
    "output disp displacement vel velocity sig excitation impact sensor"
)
_HINTS = _words("deg degree degrees rad radian radians db ms khz mhz")


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a name says.

    Parameters
    ----------
    role
        ``frf``, ``coherence``, ``frequency``, ``time``, …; ``w`` for a name that may be of either axis; else empty.
    rest
        Words that are left: which FRF, or which channel.
    hints
        Units in the name.
    quantity
        What the FRF is.
    """

    role: str
    rest: frozenset[str]
    hints: frozenset[str]
    quantity: Quantity | None = None


def tokens_of(name: str) -> tuple[str, ...]:
    """Words of a name in small letters.

    Examples
    --------
    >>> tokens_of("frequencyBand"), tokens_of("H11_dB")
    (('frequency', 'band'), ('h', '11', 'db'))
    """
    return tuple(
        token.lower() for token in _TOKEN.findall(re.sub("dB|kHz|[Mm]Hz", lambda unit: f"_{unit[0].lower()}_", name))
    )


def meaning_of(name: str) -> Meaning:
    """What the name of an array says.

    Examples
    --------
    >>> meaning_of("Hf_coh_chan_2").role, meaning_of("Freq_domain").role, meaning_of("Data1_AI_1").role
    ('coherence', 'frequency', 'signal')
    """
    tokens, small = tokens_of(name), name.lower()
    words = frozenset(tokens)
    role = next((key for key, names in ALIASES.items() if small in names), "")
    role = {"frequency_hz": "frequency", "sample_rate_hz": "rate"}.get(role, role)
    if small in SENSORS or re.fullmatch(r"time_chan_\d+", small):
        role = "signal"
    role = role or next((role for role, its in _ROLES if words & its), "") or _axis(words)
    if not role and (words & _FRF or not _FRF_FIRST.isdisjoint(tokens[:1])):
        role = "frf"
    if not role and words & _SIGNAL:
        role = "signal"
    quantity = next((q for q, its in _QUANTITIES.items() if words & its), None)
    used = dict(_ROLES).get(role, frozenset()) | _FRF | _FRF_FIRST | _HINTS | {"time", "chan", "channel"}
    return Meaning(role, words - used, words & _HINTS, quantity)


def _axis(words: frozenset[str]) -> str:
    """Role of a name of an axis, or of a number that makes one."""
    frequency = words & _FREQUENCY or ({"f"} <= words <= _BESIDE_F)
    if words & _SAMPLING and words & (_FREQUENCY | {"rate"}):
        return "rate"
    if words in ({"dt"}, {"ts"}, {"delta", "t"}) or (words & _SAMPLING and words & _words("time interval period")):
        return "interval"
    if "omega" in words or (words & {"rad"} and (frequency or "w" in words)):
        return "omega"
    if words == {"w"} or words & _LIMIT:
        return "w" if words == {"w"} else ""
    if "df" in words or (frequency and words & _STEP):
        return "f_step"
    if frequency:
        return "f_start" if words & _START else "frequency"
    return "time" if words & _words("time zeit temps") or words in ({"t"}, {"t", "s"}) else ""
