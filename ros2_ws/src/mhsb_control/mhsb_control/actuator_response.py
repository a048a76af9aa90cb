"""Response of an actuator to its valve command, learnt from its motion: inverse curve and delay.

The inverse curve g of one direction gives the command u that moves the piston at the speed v ≥ 0.
It is piecewise linear over a few speeds v_k, with the commands θ_k there. The dead band is θ_0.

    u = g(v) = Σ_k φ_k(v) θ_k,    φ_k triangular

A Kalman filter estimates θ from pairs of speed and command. V is the speed at the full command. The
flow through a valve is assumed to lie between two curves: proportional to its opening, and
proportional to the power γ of its opening. p is the mean of both curves, b half of their
difference:

    p(v) = ½ (v/V)^(1/γ) + ½ v/V,    b(v) = ½ (v/V)^(1/γ) − ½ v/V

If the machine file declares a table of the valve's curve, p is that curve with its dead band, and b
is 0. The initial covariance P₀ says how the real curve may differ from p: by a dead band, a gain,
an exponent, and single knots.

    P₀ = σ_d² 1 1ᵀ + σ_g² (p − p(0)) (p − p(0))ᵀ + b bᵀ + (σ_b c)² I,    c = V_max/V

So one pair moves the whole curve. The covariance returns to P₀ with the time constant
of forgetting, so that it neither vanishes nor grows. Precision is relative to c, the share of the
full command that the speed limit needs: a valve that is large for its cylinder needs small
commands.

The delay h is the time between a command and the motion that it causes. It contains dead time and
lag. For each candidate h, the mean speed x_h that the commands should have caused in a window is
compared with the measured mean speed y. The best candidate has the smallest residual. The sums run
over all windows:

    J_h = Σ y² − (Σ x_h y)² / Σ x_h²

This residual does not depend on the gain of the curve.

Source: L. Ljung, System Identification (recursive least squares; delay by a grid of candidates).
"""

from dataclasses import dataclass

import numpy as np

from mhsb_control.estimates_file import DirectionResponse
from mhsb_model.types import FloatArray

SPEED_KNOTS = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5])
"""Speeds at which a curve has its knots, as shares of the actuator's speed limit."""


@dataclass(frozen=True)
class ResponseSettings:
    """Tuned numbers of the estimates of an actuator's response.

    The effect of 30 % smaller and larger numbers has not been measured.
    """

    dead_band_deviation: float = 0.2
    """Standard deviation σ_d of the dead band, a share of the full command, 0.01 … 0.5.

    Origin: excavators have 0.1 to 0.48."""
    known_dead_band_step: float = 0.02
    """First step of the dead band after the valve has driven the piston, as a share of c, 0.005 …
    0.5.

    Origin: chosen; with a larger value, slow speeds would never be learnt."""
    min_driven_ratio: float = 0.1
    """Smallest measured speed that shows that the valve has driven the piston, as a share of the
    speed limit, 0.02 … 1. It applies to windows of 0.2 s; in longer windows the piston must make
    the same stroke. `known_dead_band_step` is used from then on.

    Origin: a piston that oscillates on its oil is slower. When oscillations counted, an 8 t machine
    stood still for over a minute (2 of 8 random plants)."""
    dead_band_step: float = 0.05
    """Largest step by which the dead band is raised, as a share of the full command, 0.005 … 0.2.

    Origin: chosen; half of the full dead band is crossed in some seconds."""
    step_doubling: float = 5.0
    """Number of independent windows without motion after which the step of the dead band doubles, 1
    … 100.

    Origin: chosen; a second of standstill with windows of 0.2 s."""
    max_dead_band: float = 0.6
    """Smallest command at which a standing piston counts as blocked, as a share of the full
    command, 0.3 … 1.

    Origin: excavators have up to 0.48."""
    gain_deviation: float = 0.4
    """Standard deviation σ_g of the gain, a share of the assumed one, 0.05 … 1.

    Origin: ± 20 % of the rated flow, ± 25 % by the load, and the bend of the curve."""
    max_exponent: float = 1.8
    """Largest exponent γ of the flow over the opening, 1 … 3.

    Origin: metering notches (github ZiqingZou/EfficientTrack)."""
    bend_deviation: float = 0.125
    """Standard deviation σ_b of single knots, a share of c, 0.01 … 0.5.

    It is also the first step by which the dead band is raised above a command that has not moved
    the piston. Origin: chosen; the part that exponents do not describe. After the first step the
    piston starts at an eighth of its speed limit."""
    command_deviation: float = 0.05
    """Standard deviation of a command at a measured speed, a share of c, 0.01 … 0.5.

    Origin: chosen; the load changes the speed by some percent within a move."""
    speed_deviation: float = 0.01
    """Standard deviation of a measured speed, a share of the speed limit, 0.001 … 0.1.

    A lower speed counts as standstill. It holds for windows of 0.2 s; in longer ones the same
    stroke counts, once the valve has driven the piston. Origin: 0.5 mrad of an encoder with 13 bits
    in a window of 0.2 s. Below it, the command passes linearly through the dead band."""
    forgetting_time: float = 2000.0
    """Time in which the covariance relaxes to the initial one [s], 100 … 1e5.

    Origin: with σ_d and windows of 0.2 s, the dead band follows within about two seconds, which is
    longer than the delay; oil warms up in minutes. With 120 s it follows the noise of each window:
    piston errors are twice as large on one cylinder."""
    min_slope_ratio: float = 0.1
    """Smallest slope of a curve, as a share of the assumed one, 0.01 … 0.5.

    Origin: chosen; keeps the curve invertible."""
    max_delay: float = 0.6
    """Largest candidate of the delay [s], 0.1 … 1.

    Origin: autonomous excavators have up to 0.5 s."""
    delay_spacing: float = 0.02
    """Distance between two candidates of the delay [s], 0.005 … 0.1.

    Origin: chosen; a parabola through three candidates refines it."""
    delay_forgetting_time: float = 30.0
    """Time in which the residuals of the candidates are forgotten [s], 5 … 1000.

    Origin: chosen; several reversals fall into it."""
    min_motion: float = 0.05
    """Motion ∫ y² dt from which the delay is estimated, as a share of what one second at the speed
    limit gives, 0.001 … 10.

    Origin: chosen; about one reversal at a third of the speed limit."""


class InverseCurve:
    """Inverse valve curve of one direction: the command for each piston speed, with its covariance.

    Attributes:
        speeds: Speeds of the knots, float64[k], [m/s].
        commands: Commands at the knots, float64[k]; strictly increasing.
        covariance: Covariance of `commands`, float64[k, k].
        known_speed: Speed of the fastest knot that counts as known [m/s]; 0 if there is none. A
            knot counts as known once its standard deviation has been below half of the initial
            value.
    """

    def __init__(
        self,
        full_speed: float,
        max_speed: float,
        settings: ResponseSettings,
        declared: FloatArray | None = None,
    ) -> None:
        """Build the declared curve, or an assumed curve without a dead band.

        At each speed, the assumed command is the mean of the commands of two curves. In the first
        curve, the speed is proportional to the command. In the second, it is proportional to the
        power `max_exponent` of the command. A declared curve is raised where it increases too
        little (`min_slope_ratio`).

        The initial covariance follows from the deviations of dead band, gain and bend in
        `settings`. For the assumed curve, half the difference of both curves counts as a further
        deviation.

        Args:
            full_speed: Assumed speed at the full command [m/s].
            max_speed: Speed limit of the actuator, which scales the knots [m/s].
            settings: Tuned numbers.
            declared: Commands at the knots by the table of the machine file, not decreasing,
                float64[k]; None without a table.
        """
        self._settings = settings
        self.speeds: FloatArray = SPEED_KNOTS * max_speed
        straight = self.speeds / full_speed
        bent = straight ** (1.0 / settings.max_exponent)
        half = 0.5 * (bent - straight)
        self.commands: FloatArray = straight + half
        steps = settings.min_slope_ratio * np.diff(straight)
        self._least = np.concatenate([[0.0], np.cumsum(steps)])
        if declared is not None:
            self.commands, half = declared, np.zeros(len(declared))
            self._keep_increasing()
        self._unit = max_speed / full_speed
        driving = self.commands - self.commands[0]
        self._prior = (
            settings.dead_band_deviation**2
            + settings.gain_deviation**2 * np.outer(driving, driving)
            + np.outer(half, half)
            + (settings.bend_deviation * self._unit) ** 2 * np.eye(len(self.speeds))
        )
        self.covariance: FloatArray = self._prior.copy()
        self.known_speed = self._stood = self._fastest_pair = 0.0

    @property
    def has_driven(self) -> bool:
        """Whether the valve has driven the piston faster than it swings on its oil."""
        fast = self._settings.min_driven_ratio * self.speeds[-1] / SPEED_KNOTS[-1]
        return bool(self.known_speed > 0.0 and self._fastest_pair >= fast)

    def command_at(self, speed: float) -> float:
        """Return the command for a speed ≥ 0 [m/s]; for speed 0 it is the dead band.

        Beyond the last knot the curve is extended as a straight line. A command above 1 means that
        the speed cannot be reached.
        """
        beyond = max(speed - self.speeds[-1], 0.0)
        slope = (self.commands[-1] - self.commands[-2]) / (self.speeds[-1] - self.speeds[-2])
        return float(np.interp(speed, self.speeds, self.commands) + slope * beyond)

    def speeds_at(self, commands: FloatArray) -> FloatArray:
        """Return the speeds that commands ≥ 0 cause [m/s].

        A speed is 0 within the dead band, and at most the speed of the last knot.
        """
        return np.interp(commands, self.commands, self.speeds)

    @property
    def learnt(self) -> DirectionResponse:
        """The curve for an estimates file, as tuples with one value for each knot.

        Speeds are in m/s. Commands and their standard deviations are shares of the full command.
        `known_speed` [m/s] is 0 if no speed has been measured yet.
        """
        columns = self.speeds, self.commands, np.sqrt(np.diag(self.covariance))
        speeds, commands, deviations = (tuple(each.tolist()) for each in columns)
        return DirectionResponse(
            speeds=speeds, commands=commands, deviations=deviations, known_speed=self.known_speed
        )

    def restore(self, learnt: DirectionResponse) -> None:
        """Replace the curve by a curve from an estimates file.

        The file's curve is interpolated at the knots of this curve, and raised where it increases
        too little. The standard deviations come from the file, but are at most those of a new
        curve. The correlations are those of a new curve. `known_speed` comes from the file, too,
        but is at most the speed of the last knot.

        Args:
            learnt: Curve from an estimates file.
        """
        self.commands = np.interp(self.speeds, learnt.speeds, learnt.commands)
        self._keep_increasing()
        initial = np.sqrt(np.diag(self._prior))
        deviations = np.interp(self.speeds, learnt.speeds, learnt.deviations)
        ratio = np.minimum(deviations / initial, 1.0)
        self.covariance = self._prior * np.outer(ratio, ratio)
        self.known_speed = min(learnt.known_speed, float(self.speeds[-1]))
        self._fastest_pair = self.known_speed

    def learn(
        self,
        speed: float,
        command: float,
        weight: float,
        spread: float = 0.0,
        lowers_slower_knots: bool = False,
    ) -> None:
        """Update the curve with a measured speed and the command that caused it.

        A Kalman filter corrects the commands at all knots, and their covariance. `known_speed`
        rises to the speed of the fastest knot whose standard deviation has fallen below half of its
        initial value. The speed counts for `has_driven`, and the next call of `raise_dead_band`
        uses its first step again.

        Args:
            speed: Measured speed ≥ 0 [m/s].
            command: Command, 0 … 1.
            weight: Weight of this pair of speed and command, above 0 and at most 1. It is 1 if the
                pair is independent of earlier pairs, and less if its time window overlaps earlier
                windows.
            spread: Standard deviation of the command within the time window.
            lowers_slower_knots: True if slower knots are lowered where this command is too low for
                an increasing curve; False if the command itself is raised.
        """
        self._stood = 0.0
        self._fastest_pair = max(self._fastest_pair, speed)
        noise = self._settings.speed_deviation * self.speeds[-1] / SPEED_KNOTS[-1]
        passed = self.command_at(speed + noise) - self.command_at(max(speed - noise, 0.0))
        share = self._shares(speed)
        deviations = self._settings.command_deviation * self._unit, spread, 0.5 * passed
        variance = sum(deviation * deviation for deviation in deviations)
        kept = int(np.argmax(share)) if lowers_slower_knots else 0
        gain = self._correct(share, command, variance / weight, kept)
        self.covariance -= np.outer(gain, self.covariance @ share)
        known = self.covariance.diagonal() < 0.25 * self._prior.diagonal()
        self.known_speed = max(self.known_speed, float(self.speeds[known].max(initial=0.0)))

    def _correct(
        self, share: FloatArray, command: float, variance: float, kept: int = 0
    ) -> FloatArray:
        """Correct the commands of all knots with one pair of speed and command.

        The covariance is not changed.

        Args:
            share: Weights φ_k of the knots at the speed of the pair, float64[k].
            command: Command of the pair, 0 … 1.
            variance: Variance of the pair's command.
            kept: Index of the knot that keeps its corrected command (`_keep_increasing`).

        Returns:
            Gain: the change of each knot's command per error of the pair's command, float64[k] [-].
        """
        correlated = self.covariance @ share
        gain = correlated / (share @ correlated + variance)
        self.commands += gain * (command - share @ self.commands)
        self._keep_increasing(kept)
        return gain

    def _shares(self, speed: float) -> FloatArray:
        """Return the weights φ_k of the knots at a speed, float64[k].

        Beyond the last knot, the weight of the last knot is 1 and all others are 0.
        """
        k = min(int(np.searchsorted(self.speeds, speed, "right")), len(self.speeds) - 1)
        left, right = self.speeds[k - 1 : k + 1]
        shares = np.zeros(len(self.speeds))
        shares[k] = min((speed - left) / (right - left), 1.0)
        shares[k - 1] = 1.0 - shares[k]
        return shares

    def raise_dead_band(self, command: float, weight: float) -> None:
        """Raise the dead band because a command above it has not moved the piston.

        A command within the present dead band is ignored. A command of `max_dead_band` or more is
        ignored too, since then the piston is blocked. The dead band becomes this command plus a
        step. The commands at the other knots change in proportion to their covariance with the dead
        band. The covariance does not change, because the command is only a lower bound of the dead
        band.

        The first step is smaller if the valve has already driven the piston. The step doubles with
        every `step_doubling` calls of weight 1 since the last motion, up to `dead_band_step`.

        Args:
            command: Command, 0 … 1.
            weight: Weight of this observation, above 0 and at most 1. It is 1 for an observation
                that shares no measurement with others.
        """
        if self.commands[0] < command < self._settings.max_dead_band:
            s = self._settings
            first = s.known_dead_band_step if self.has_driven else s.bend_deviation
            step = first * self._unit * 2.0 ** (self._stood / s.step_doubling)
            self._correct(self._shares(0.0), command + min(step, s.dead_band_step), 0.0)
            self._stood += weight

    def forget(self, time: float) -> None:
        """Move the covariance towards the initial covariance.

        Args:
            time: Time since the previous call [s].
        """
        share = min(time / self._settings.forgetting_time, 1.0)
        self.covariance += share * (self._prior - self.covariance)

    def _keep_increasing(self, kept: int = 0) -> None:
        """Change commands where needed, so that the curve begins at 0 or above and increases.

        The slope between two knots is then at least `min_slope_ratio` times the assumed one. One
        knot keeps its command. Slower knots are lowered, and faster ones are raised. So a dead band
        that was taken too large gives way to a measured command.

        Args:
            kept: Index of the knot that keeps its command. It is raised only if it is too low for
                the slopes between the slower knots.
        """
        above = self.commands - self._least
        above[kept:] = np.maximum.accumulate(above[kept:])
        above[: kept + 1] = np.minimum.accumulate(above[kept::-1])[::-1]
        self.commands = np.maximum(above, 0.0) + self._least


class DelayEstimate:
    """Delay between commands and motion, the best of a grid of candidates.

    Attributes:
        candidates: Candidates of the delay, float64[c], [s].
        delay: Estimated delay [s]; the expected delay until there has been enough motion.
        is_known: Whether there has been enough motion to estimate the delay.
    """

    def __init__(self, expected: float, max_speed: float, settings: ResponseSettings) -> None:
        """Build the estimate before any motion.

        Args:
            expected: Delay that is assumed until it can be estimated [s].
            max_speed: Speed limit of the actuator, which scales the motion needed for an estimate
                [m/s].
            settings: Tuned numbers.
        """
        count = round(settings.max_delay / settings.delay_spacing) + 1
        self.candidates: FloatArray = settings.delay_spacing * np.arange(count, dtype=np.float64)
        self.delay, self.is_known = expected, False
        self._forgetting_time = settings.delay_forgetting_time
        self._least = settings.min_motion * max_speed**2
        self._moved = 0.0
        self._products, self._squares = np.zeros(count), np.zeros(count)

    def learn(self, expected: FloatArray, moved: float, time: float) -> None:
        """Update the estimate of the delay with the mean speed of the piston in a window.

        The estimate is the candidate whose expected speeds fit the measured ones best, apart from a
        constant factor. A parabola through the neighbouring candidates refines it. Older windows
        are forgotten with the time constant `delay_forgetting_time`. The estimate does not change
        before the piston has moved enough (`min_motion`).

        Args:
            expected: Mean speed that the commands should have caused in the window, for each
                candidate delay, float64[c], [m/s].
            moved: Measured mean speed [m/s].
            time: Time since the previous call [s].
        """
        keep = max(1.0 - time / self._forgetting_time, 0.0)
        self._moved = keep * self._moved + time * moved**2
        self._products = keep * self._products + time * expected * moved
        self._squares = keep * self._squares + time * expected**2
        if self._moved < self._least or not (self._squares > 0.0).all():
            return
        residual = self._moved - np.maximum(self._products, 0.0) ** 2 / self._squares
        k = min(max(int(residual.argmin()), 1), len(residual) - 2)
        before, at, after = residual[k - 1 : k + 2]
        bend = before - 2.0 * at + after
        shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        spacing = self.candidates[1]
        self.delay = float(self.candidates[k] + spacing * min(max(shift, -1.0), 1.0))
        self.is_known = True
