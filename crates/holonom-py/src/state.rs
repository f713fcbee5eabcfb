//! States between NumPy and the core.

use crate::{SimulationError, report};
use holonom::system::{Ledger, Sizes, State};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Rows of arrays as they come from a result.
pub(crate) struct Rows {
    pub(crate) states: Vec<State>,
}

/// A state that is not one of this model.
pub(crate) fn foreign(message: &str) -> PyErr {
    let help = "pass what `Result.state` returns for the same model";
    SimulationError::new_err(report::refusal("simulation/start-state", message, None, help))
}

fn array(data: &Bound<'_, PyDict>, name: &str) -> PyResult<Option<Vec<f64>>> {
    let Some(item) = data.get_item(name)? else { return Ok(None) };
    let numpy = item.py().import("numpy")?;
    let flat = numpy
        .call_method1("ascontiguousarray", (item, "f8"))?
        .extract::<PyReadonlyArrayDyn<'_, f64>>()?;
    Ok(Some(flat.as_slice()?.to_vec()))
}

impl Rows {
    /// Reads `count` states (as many as there are times) from arrays by name. The state that a run `starts` from may be one of
    /// another joint more or less, whose multipliers and turns it finds anew.
    pub(crate) fn read(data: &Bound<'_, PyDict>, sizes: &Sizes, starts: bool) -> PyResult<Self> {
        let time = array(data, "time")?.ok_or_else(|| foreign("the state has no entry `time`"))?;
        let count = time.len();
        let mut states = vec![State::zeros(sizes); count];
        for (state, t) in states.iter_mut().zip(time) {
            state.t = t;
        }
        let n = sizes.coordinates;
        for (name, size, required) in [
            ("q", n, true),
            ("qd", n, true),
            ("qdd", n, false),
            ("lambda", sizes.rows, false),
            ("z", sizes.extra_states, sizes.extra_states > 0),
            ("winding", sizes.windings, sizes.windings > 0),
            ("ledger", 3, false),
        ] {
            let Some(values) = array(data, name)? else {
                if required {
                    return Err(foreign(&format!("the state has no entry `{name}`")));
                }
                continue;
            };
            // What a joint that has let go carried and counted: multipliers are found anew.
            let gone = starts && count == 1 && (name == "lambda" || name == "winding" && size == 0);
            if gone && values.len() != size {
                continue;
            }
            if values.len() != size * count {
                let found = values.len();
                return Err(foreign(&if count == 1 {
                    format!("`{name}` has {found} numbers; a state of this model has {size}")
                } else {
                    format!("`{name}` has {found} numbers for {count} states of {size} each")
                }));
            }
            if size == 0 {
                continue;
            }
            for (state, row) in states.iter_mut().zip(values.chunks_exact(size)) {
                match name {
                    "q" => state.q.copy_from_slice(row),
                    "qd" => state.v.copy_from_slice(row),
                    "qdd" => state.a.copy_from_slice(row),
                    "lambda" => state.lambda.copy_from_slice(row),
                    "z" => state.z.copy_from_slice(row),
                    "winding" => state.winding.copy_from_slice(row),
                    _ => {
                        state.ledger =
                            Ledger { initial: row[0], dissipated: row[1], supplied: row[2] };
                    }
                }
            }
        }
        let finite = |s: &State| {
            let lists = [&s.q, &s.v, &s.a, &s.lambda, &s.z, &s.winding];
            let ledger = [s.t, s.ledger.initial, s.ledger.dissipated, s.ledger.supplied];
            lists.into_iter().flatten().chain(&ledger).all(|x| x.is_finite())
        };
        if !states.iter().all(finite) {
            return Err(foreign("the state holds a number that is not finite"));
        }
        Ok(Self { states })
    }
}

/// States as arrays by name, as a result stores them.
pub(crate) fn to_python<'py>(
    py: Python<'py>,
    states: &[State],
    sizes: &Sizes,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let times: Vec<f64> = states.iter().map(|s| s.t).collect();
    dict.set_item("time", PyArray1::from_slice(py, &times))?;
    let n = sizes.coordinates;
    type Part = fn(&State) -> &[f64];
    let parts: [(&str, usize, Part); 6] = [
        ("q", n, |s| &s.q),
        ("qd", n, |s| &s.v),
        ("qdd", n, |s| &s.a),
        ("lambda", sizes.rows, |s| &s.lambda),
        ("z", sizes.extra_states, |s| &s.z),
        ("winding", sizes.windings, |s| &s.winding),
    ];
    for (name, size, part) in parts {
        let values: Vec<f64> = states.iter().flat_map(part).copied().collect();
        dict.set_item(name, rows(py, &values, states.len(), &[size])?)?;
    }
    let ledgers = states.iter().map(|s| &s.ledger);
    let values: Vec<f64> = ledgers.flat_map(|l| [l.initial, l.dissipated, l.supplied]).collect();
    dict.set_item("ledger", rows(py, &values, states.len(), &[3])?)?;
    Ok(dict)
}

/// An array of rows with the given shape of one row.
pub(crate) fn rows<'py>(
    py: Python<'py>,
    values: &[f64],
    count: usize,
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let mut full = vec![count];
    full.extend_from_slice(shape);
    Ok(PyArray1::from_slice(py, values).reshape(full)?.into_any())
}
