"""The name that was meant: by its spelling, or by the word that another code has for it."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Mapping

from holonom.base.text import NAME, quoted

#: Words of other codes for the options of a run.
OPTIONS = {
    "end_time": "t_end tend tf t_final tfinal t_stop tstop stop_time stop duration until t1 t_max",
    "start_time": "t0 t_start tstart begin t_begin",
    "tolerance": "tol rtol atol reltol abstol rel_tol abs_tol eps epsilon error accuracy precision",
    "method": "solver integrator algorithm scheme code stepper alg",
    "formula": "tableau order",
    "interval": "dt_out dtout output_step output_interval save_every saveat sampling sample_time"
    " report_step print_step tout every",
    "output_times": "t_eval teval times tspan t_span time_points tlist",
    "channels": "channel outputs output_channels signals variables quantities observables sensors",
    "fixed_step": "dt h step step_size stepsize time_step timestep delta_t hfix",
    "max_step": "hmax h_max dtmax dt_max maxstep max_dt largest_step max_step_size maximum_step",
    "initial_step": "h0 hini dt0 first_step initial_dt h_init",
    "max_steps": "nsteps n_steps mxstep maxsteps max_iter maxiter num_steps max_num_steps",
    "max_seconds": "timeout time_limit wall_time walltime max_time cpu_limit",
    "threads": "nthreads n_threads num_threads n_jobs jobs workers cores cpus parallel",
    "dense_output": "dense continuous_output interpolate",
    "jacobian": "jac jacobi",
    "newton": "linear_solver linsol matrix sparse",
    "newmark_gamma": "gamma",
    "newmark_beta": "beta",
    "certify": "verify estimate_error",
    "output": "file filename path outfile out result save save_as to target",
    "start": "x0 y0 initial_state initial restart",
    "parametrization": "coordinates",
}

#: Words for the parts of a tolerance.
TOLERANCES = {
    "relative": "rel rtol reltol relative_tolerance",
    "translation": "atol abs abstol absolute position translational length",
    "rotation": "angle rotational orientation angular",
}

#: Names of other codes for methods; where there is no such method, the one that serves its purpose.
METHODS = {
    "ForRadau": "radau radau5 radauiia bdf lsoda ode15s cvode ida dassl daspk gstiff wstiff si2"
    " implicit stiff vode dae",
    "ForSDIRK": "sdirk sdirk4 esdirk kvaerno trbdf2",
    "ForRosen": "rosenbrock rodas ros4 ode23s ros34pw2 row",
    "SspTrap": "trapezoidal trapezoid trapezium newmark crank-nicolson cranknicolson ode23t hht"
    " hht-alpha alpha generalized-alpha generalized_alpha midpoint",
    "DOPRI5": "dopri dormand-prince dormandprince rk45 ode45 rkf45 rk4 rk tsit5 explicit euler"
    " runge-kutta rungekutta",
    "DOP853": "dop8 rk8 rk87 ode78 ode89 vern7 vern8 vern9 tsit8 rkf78",
    "DEABM": "adams adams-bashforth adams-moulton abm ab ode113 predictor-corrector",
}

#: Words for quantities of channels.
QUANTITIES = {
    "angular_velocity": "omega w angvel angular_speed rpm rate_of_turn wx wy wz turn_rate spin",
    "angular_acceleration": "alpha angacc domega",
    "position": "pos x y z r displacement translation location coordinates xyz",
    "velocity": "vel v speed vx vy vz xdot",
    "acceleration": "acc accel a ax ay az",
    "euler_parameters": "quaternion quat orientation e p attitude",
    "angle": "theta phi rotation rot heading deg",
    "yaw_pitch_roll": "ypr rpy euler euler_angles yaw pitch roll cardan",
    "force": "f reaction load tension fx fy fz",
    "torque": "moment m t couple",
    "length": "distance l",
    "rate": "ldot length_rate",
    "kinetic": "ke t ekin kinetic_energy",
    "potential": "pe v epot potential_energy",
    "total": "e etot mechanical sum",
}

#: Words for commands.
COMMANDS = {
    "run": "simulate solve start integrate sim exec",
    "check": "validate lint test verify inspect",
    "info": "show status summary describe cat",
    "plot": "draw graph figure",
    "export": "csv save convert dump",
    "compare": "benchmark bench study",
    "diff": "difference differences cmp delta versus",
    "report": "html page",
    "view": "open 3d animate animation play",
    "render": "film movie video gif mp4 png picture image",
    "models": "list ls library catalog catalogue examples mechanisms",
    "schema": "reference format fields",
}


#: Letters from which a word may be the beginning of another one.
_BEGINNING = 3


def nearest(
    name: object, known: Collection[str], words: Mapping[str, str] | None = None, most: int = 1
) -> list[str]:
    """Return the known names that a name is meant for, likeliest first; perhaps none.

    Parameters
    ----------
    name : str
    known : collection of str
    words : mapping of str to str, optional
        Words of others for some of the known names, with spaces between them.
    most : int, optional
        How many at most.
    """
    text = str(name)
    if len(text) > NAME:  # nobody mistypes that much
        return []
    plain = text.strip().lower()
    found = [one for one in known if one.lower() == plain]
    for meant, others in (words or {}).items():
        if meant in known and plain in others.split():
            found.append(meant)
    if len(plain) >= _BEGINNING:  # what begins so is meant rather than what looks like it
        found += sorted((one for one in known if one.lower().startswith(plain)), key=len)
    found += difflib.get_close_matches(text, known, n=most, cutoff=0.55)
    if not found and words:  # a word of another code, mistyped
        of_word = {word: one for one in words if one in known for word in words[one].split()}
        found = [of_word[word] for word in difflib.get_close_matches(plain, of_word, 1, 0.8)]
    return list(dict.fromkeys(found))[:most]


def nearest_channels(name: str, known: Iterable[str], most: int = 3) -> list[str]:
    """Return the channels that a name is meant for: ``rod.omega`` is ``rod.angular_velocity``."""
    all_names = list(known)
    item, dot, quantity = name.rpartition(".")
    if not dot or len(name) > NAME:
        return nearest(name, all_names, most=most)
    of_item: dict[str, str] = {}
    items: dict[str, None] = {}
    for channel in all_names:
        owner, _, what = channel.rpartition(".")
        items[owner] = None
        if owner == item:
            of_item[what] = channel
    if of_item:
        found = [of_item[what] for what in nearest(quantity, of_item, QUANTITIES, most)]
        return found or list(of_item.values())[:most]
    found = [
        f"{owner}.{quantity}"
        for owner in nearest(item, items, most=most)
        if f"{owner}.{quantity}" in all_names
    ]
    return found or nearest(name, all_names, most=most)


def did_you_mean(names: Collection[str], otherwise: str) -> str:
    """Return a help line that offers names, or says `otherwise` where there are none."""
    if not names:
        return otherwise
    return f"did you mean {' or '.join(map(quoted, names))}?"


def listed(names: Iterable[str]) -> str:
    """Return names in backticks with commas."""
    return ", ".join(map(quoted, names))
