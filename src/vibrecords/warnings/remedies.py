"""What to do about each warning, by its key."""

from vibrecords.provenance import MeasurementWarning

REMEDIES = {
    "zero_lines": "a case leaves such lines out, up to half of all; f_min_hz, f_max_hz and exclude_hz cut more",
    "zero_hz": "cut it with f_min_hz",
    "lines_out_of_order": "sort the lines, drop doubled ones",
    "uneven_lines": "look for lines that were left out, or for a sweep; noise of a sweep's lines has its own law",
    "rad_per_s": "divide the frequencies by 2π, or say rad/s in the header of the column",
    "not_finite": "a case leaves such lines out, up to half of all; repair them if they matter",
    "constant": "look whether the right column or channel was exported, and export it again",
    "real_only": "export real and imaginary part, or magnitude and phase",
    "noise_only": "look whether the sensor was connected and the structure was driven, and measure again",
    "coherence_missing": "export it as well, or state the noise in [data.variance], or give repeated measurements",
    "coherence_one": "export it again, or state the noise in [data.variance], or give repeated measurements",
    "coherence_range": "export again",
    "averages_missing": "add the number of averages",
    "quantity_missing": 'write in [data] of the case quantity = "accelerance", or what it is',
    "quantity_phase": "find out the quantity of the sensor and state it",
    "quantity_units": "find out which is right and state the quantity",
    "unit_missing": "find out the unit of the sensor, and scale the channel by its gain if it is another",
    "unit_unknown": "state the units of response and force in [data.channels]; natural frequencies need none",
    "unit_inverse": "export receptance, mobility or accelerance; no mode can be read from this one",
    "unit_system": "find out which is right, and scale the channel by its gain if it is the other",
    "sign_flip": 'turn the channel in the case file ("-11:y")',
    "g_against_ms2": "find out the unit of the accelerometer and give the channel the gain 9.80665",
    "mass_line": "find out the unit of the accelerometer",
    "conjugated": "write conjugate = true in [data], or take it away where it stands; turn no channel's sign",
    "not_passive": "look whether force and response are at one point in one direction, and at phase and delay",
    "antiresonance_missing": "look whether force and response are at one point in one direction, and at their labels",
    "leakage": "measure longer blocks, and once more at half the level; do not trust height and damping of the peak",
    "excitation_ends": "end the band there (f_max_hz), or hit with a harder tip, or drive with a wider band",
    "mains": "leave these lines out (exclude_hz); look at grounding and at the cables of the sensors",
    "level_dependence": "measure at one level, the lower the better, or give each level a test of its own",
    "mass_loading": "state accelerometer_mass_g in [data.channels], which takes it out, or measure all at once",
    "dead_channel": "look at cable and channel",
    "overload": "leave this hit out, and measure with a larger range",
    "double_hit": "leave this hit out",
    "truncated_ring_down": "measure longer blocks, or use an exponential window (exponential_end in [data.records])",
    "exponential_window": "write its time constant in s as exponential_tau_s in [data]; its damping is then taken out",
    "offset": "take the offset away, or couple the channel AC",
    # in what two FRFs that should be equal differ
    "shape": "look at labels and directions, the mass of the accelerometer, and whether the structure is linear",
    "quantity": "find out the quantity of each sensor and state it",
    "g": "find out which channel is in g and give it the gain 9.80665",
    "factor": "compare sensitivities and units of the channels; 1000 is mm against m, 4.45 is lbf against N",
    "sign": 'turn one of the channels in the case file ("-11:y")',
}


def warn(key: str, sentence: str, remedy: str = "") -> MeasurementWarning:
    """The warning of a key, with its remedy, unless another is given."""
    return MeasurementWarning(key, sentence, remedy or REMEDIES[key])
