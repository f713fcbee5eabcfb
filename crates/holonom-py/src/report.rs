//! Plain data of the core as JSON.

use holonom::analysis::Spectrum;
use holonom::error::{Diagnostic, Location, ModelErrors};
use holonom::method::{CODES, Code};
use holonom::model::{Dimension, Model};
use holonom::reduction::assembly::{Assembled, AssemblyError};
use holonom::simulation::{
    AccelerationSummary, Choices, LimitedBy, ModelSummary, Problem, RunWarning, Status, Summary,
};
use holonom::system::System;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use pyo3::{IntoPyObjectExt, Py, PyAny};
use serde_json::{Value, json};

/// Plain data as Python has it.
pub(crate) fn to_python(py: Python<'_>, value: &Value) -> PyResult<Py<PyAny>> {
    match value {
        Value::Null => Ok(py.None()),
        Value::Bool(flag) => flag.into_py_any(py),
        Value::String(text) => text.into_py_any(py),
        Value::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => whole.into_py_any(py),
            (None, Some(whole)) => whole.into_py_any(py),
            (None, None) => number.as_f64().into_py_any(py),
        },
        Value::Array(items) => {
            let list = PyList::empty(py);
            for item in items {
                list.append(to_python(py, item)?)?;
            }
            list.into_py_any(py)
        }
        Value::Object(entries) => {
            let dict = PyDict::new(py);
            for (key, item) in entries {
                dict.set_item(key, to_python(py, item)?)?;
            }
            dict.into_py_any(py)
        }
    }
}

pub(crate) fn methods() -> String {
    let list: Vec<Value> = CODES
        .iter()
        .map(
            |i| json!({"name": i.name, "title": i.title, "family": i.family, "formula": i.formula}),
        )
        .collect();
    Value::from(list).to_string()
}

fn diagnostic(d: &Diagnostic) -> Value {
    let at = d.location.as_ref();
    json!({
        "code": d.code.as_str(), "message": d.message, "path": d.path, "help": d.help,
        "file": at.map(|l| l.file.clone()), "line": at.map(|l| l.line),
        "column": at.map(|l| l.column), "expected": "",
    })
}

pub(crate) fn model_errors(errors: &ModelErrors) -> String {
    let list: Vec<Value> = errors.errors.iter().map(diagnostic).collect();
    json!({"errors": list, "omitted": errors.omitted, "rendered": errors.render()}).to_string()
}

/// A model that is well-formed but cannot be assembled.
pub(crate) fn assembly_error(error: &AssemblyError, place: Option<&Location>) -> String {
    let item = error.item().unwrap_or("");
    let (code, message, help) = (error.code(), error.to_string(), error.help());
    let marked = place.map_or(String::new(), |place| place.render() + "\n");
    let rendered = format!("error[{code}]: {message}\n{marked}  help: {help}\n");
    json!({
        "errors": [{
            "code": code, "message": message, "path": item, "help": help,
            "file": place.map(|place| &place.file), "line": place.map(|place| place.line),
            "column": place.map(|place| place.column), "expected": "",
        }],
        "omitted": 0, "rendered": rendered,
    })
    .to_string()
}

pub(crate) fn warnings(list: &[Diagnostic]) -> String {
    Value::from(list.iter().map(diagnostic).collect::<Vec<_>>()).to_string()
}

pub(crate) fn defaults(model: &Model) -> String {
    let (file, tolerance) = (&model.simulation, Choices::default().tolerance(model));
    json!({
        "title": model.title,
        "dimension": match model.dimension {
            Dimension::Planar => "planar",
            Dimension::Spatial => "spatial",
        },
        "start_time": file.start_time.unwrap_or(0.0),
        "end_time": file.end_time,
        "method": file.method,
        "formula": file.formula,
        "tolerance": {
            "relative": tolerance.relative,
            "translation": tolerance.translation,
            "rotation": tolerance.rotation,
        },
    })
    .to_string()
}

pub(crate) fn check(
    problem: &Problem,
    assembled: &Assembled,
    summary: &ModelSummary,
    spectrum: Option<Spectrum>,
    warnings: &[RunWarning],
) -> String {
    let model = problem.model();
    let tree: Vec<Value> = (summary.tree.iter())
        .map(|edge| {
            let coordinates: Vec<Value> = (edge.coordinates.iter())
                .map(|c| json!({ "name": c.name, "role": c.role }))
                .collect();
            json!({
                "body": edge.body, "parent": edge.parent, "kind": edge.kind, "item": edge.item,
                "coordinates": coordinates,
            })
        })
        .collect();
    let redundant: Vec<Value> = summary
        .redundant
        .iter()
        .map(|r| json!({"joint": r.item, "row": r.row, "direction": r.direction}))
        .collect();
    let adjustments: Vec<Value> = assembled
        .adjustments
        .iter()
        .map(|a| {
            json!({
                "item": a.item, "translation": a.translation, "rotation": a.rotation,
                "velocity": a.velocity, "angular_velocity": a.angular_velocity,
            })
        })
        .collect();
    json!({
        "bodies": summary.bodies, "joints": model.joints.len(), "forces": model.forces.len(),
        "drivers": model.drivers.len(), "coordinates": summary.coordinates,
        "constraint_rows": summary.rows, "joint_rows": summary.joint_rows,
        "redundant": redundant, "dof": summary.ndof, "extra_states": summary.extra_states,
        "loops": summary.loops, "floating": summary.floating,
        "characteristic_length": summary.characteristic_length,
        "pivot_ratio": summary.pivot_ratio,
        "independent_coordinates": summary.independent, "tree": tree,
        "accelerations": accelerations(&summary.accelerations),
        "joint_coordinates": summary.joint_coordinates.map(|[coordinates, rows, entries]| {
            json!({"coordinates": coordinates, "rows": rows, "factor_entries": entries})
        }),
        "end_time": model.simulation.end_time,
        "adjustments": adjustments,
        "chosen_velocities": chosen_velocities(problem),
        "warnings": run_warnings(warnings),
        "initial_residuals": {
            "position": assembled.stated_residuals.0, "velocity": assembled.stated_residuals.1,
        },
        "spectrum_is_complete": spectrum.as_ref().map(|s| s.is_complete),
        "spectrum": spectrum
            .map(|s| s.values.iter().map(|(re, im)| json!([re, im])).collect::<Vec<_>>()),
    })
    .to_string()
}

/// Initial velocities that nothing determines and that are not zero.
fn chosen_velocities(problem: &Problem) -> Vec<Value> {
    (problem.chosen_velocities().iter())
        .map(|c| json!({"coordinate": c.coordinate, "rate": c.rate, "unit": c.unit}))
        .collect()
}

fn accelerations(summary: &AccelerationSummary) -> Value {
    let costs = &summary.costs;
    json!({
        "solver": summary.way, "stated": summary.stated, "refusal": summary.refusal,
        "operations": {
            "recursive": costs.recursive.round(), "null_space": costs.null_space.round(),
            "reduced": costs.reduced.round(), "augmented": costs.augmented.round(),
        },
    })
}

pub(crate) fn summary(summary: &Summary, system: &dyn System, code: Code, simulated: f64) -> Value {
    let (s, e) = (&summary.statistics, &summary.energy);
    let cpu_seconds = s.assembly_cpu_seconds + s.run_cpu_seconds;
    let per_second = if simulated > 0.0 { cpu_seconds / simulated } else { 0.0 };
    json!({
        "status": summary.status.name(),
        "stop_reason": stop_reason(summary),
        "method": code.info().name,
        "dof": summary.ndof,
        "end_time": summary.end.t,
        "cpu_seconds": cpu_seconds,
        "cpu_seconds_per_simulated_second": per_second,
        "statistics": {
            "steps": s.steps,
            "rejected": s.rejected_error + s.rejected_newton + s.rejected_evaluation,
            "rejected_error": s.rejected_error,
            "rejected_newton": s.rejected_newton,
            "rejected_evaluation": s.rejected_evaluation,
            "evaluations": s.evaluations,
            "jacobians": s.jacobians,
            "factorizations": s.factorizations,
            "simplified_factorizations": s.simplified_factorizations,
            "changes_to_full": s.changes_to_full,
            "iterations": s.iterations,
            "contractions": s.contractions.count,
            "mean_contraction": s.contractions.mean(),
            "largest_contraction": s.contractions.largest,
            "reparametrizations": s.reparametrizations,
            "position_recoveries": s.recoveries,
            "position_corrections": s.corrections,
            "constraint_factorizations": s.constraint_factorizations,
            "acceleration_solves": s.accelerations,
            "symbolic_analyses": s.analyses,
            "stiff_steps": s.stiff_steps,
            "outputs": s.outputs,
            "smallest_step": s.smallest_step,
            "largest_step": s.largest_step,
            "assembly_seconds": s.assembly_seconds,
            "assembly_cpu_seconds": s.assembly_cpu_seconds,
            "run_seconds": s.run_seconds,
            "run_cpu_seconds": s.run_cpu_seconds,
            "output_seconds": s.output_seconds,
            "cpu_seconds": cpu_seconds,
            "cpu_seconds_per_simulated_second": per_second,
        },
        "residuals": {
            "position": s.position_residual,
            "velocity": s.velocity_residual,
            "largest_over_bound": s.residual_ratio,
        },
        "energy": {
            "initial": summary.end.ledger.initial + e.missing,
            "kinetic": e.end.kinetic,
            "potential": e.end.potential,
            "total": e.end.kinetic + e.end.potential,
            "dissipated": e.dissipated,
            "driver_work": e.supplied,
            "imbalance": e.imbalance,
            "largest_imbalance": e.largest_imbalance,
            "range": e.range,
            "moved": e.moved,
        },
        "limited_by": limited_by(&summary.limited_by(system)),
        "warnings": run_warnings(&summary.warnings),
    })
}

fn limited_by(limited: &LimitedBy) -> Value {
    let (coordinate, count) = limited.coordinate.clone().unzip();
    let (at, force, rejected) = match limited.rejected.clone() {
        Some((coordinate, force, count)) => (Some(coordinate), force, count),
        None => (None, None, 0),
    };
    json!({
        "coordinate": coordinate, "steps": count.unwrap_or(0), "of": limited.steps,
        "rejected": {
            "coordinate": at, "force": force, "steps": rejected, "of": limited.rejected_steps,
        },
    })
}

fn run_warnings(warnings: &[RunWarning]) -> Vec<Value> {
    let data = |w: &RunWarning| json!({"code": w.code, "message": w.message, "path": ""});
    warnings.iter().map(data).collect()
}

/// Why the run ended; what does not apply is left out.
fn stop_reason(summary: &Summary) -> Value {
    let stop = &summary.stop;
    let mut reason = json!({"code": stop.code, "message": stop.message, "time": stop.time});
    if summary.status == Status::Failed {
        reason["step_size"] = stop.step_size.into();
    }
    let texts = [
        ("item", stop.item.as_deref()),
        ("coordinate", stop.coordinate.as_deref()),
        ("help", Some(stop.help)),
    ];
    for (key, text) in texts {
        if let Some(text) = text.filter(|text| !text.is_empty()) {
            reason[key] = text.into();
        }
    }
    reason
}

pub(crate) fn refusal(code: &str, message: &str, item: Option<&str>, help: &str) -> String {
    json!({"code": code, "message": message, "time": null, "item": item, "help": help}).to_string()
}
