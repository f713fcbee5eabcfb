//! Dense output between the core and Python: steps as flat arrays, charts as JSON with their numbers.

use crate::{SimulationError, report};
use holonom::reduction::{Parametrization, Projection, Relatives, Source};
use holonom::simulation::{ChartRecord, Segments};
use holonom::system::Anchor;
use holonom::topology::Forest;
use numpy::{PyArray1, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde::{Deserialize, Serialize};

/// A chart without its long rows of numbers.
#[derive(Debug, Serialize, Deserialize)]
struct ChartText {
    parametrization: String,
    ndof: usize,
    kept: Vec<usize>,
    dropped: Vec<usize>,
    follows: bool,
    /// Missing in results of before.
    #[serde(default)]
    own_axes: bool,
    #[serde(default)]
    in_second_axes: Vec<usize>,
    independent: Option<Vec<usize>>,
    tree: Option<TreeText>,
    forest: ForestText,
}

/// Relative coordinates.
#[derive(Debug, Serialize, Deserialize)]
struct TreeText {
    forms: Vec<usize>,
    rows: Vec<(usize, usize)>,
    sources: Vec<[SourceText; 6]>,
    exact: bool,
    has_alternatives: bool,
    moves: bool,
}

/// Null for a dependent coordinate, a number for an independent one; row, sign and constant of a driven one.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(untagged)]
enum SourceText {
    Dependent,
    Independent(usize),
    Driven(usize, f64, f64),
}

#[derive(Debug, Serialize, Deserialize)]
struct ForestText {
    edge: Vec<Option<usize>>,
    parent: Vec<Option<usize>>,
    order: Vec<usize>,
    edges: usize,
}

const PARTITIONING: &str = "partitioning";
const TANGENT_PLANE: &str = "tangent_plane";
const TREE: &str = "tree";
/// Numbers of a reference, and of an anchor: four of the orientation, then the coordinates.
const REFERENCE: usize = 6;
const ANCHOR: usize = 10;

/// Text and numbers of a chart: q, then the rows of a basis, or references and anchors.
fn encode(chart: &ChartRecord) -> (String, Vec<f64>) {
    let p = &chart.parametrization;
    let mut numbers = chart.q.clone();
    let (mut independent, mut tree) = (None, None);
    let name = match &p.projection {
        Projection::Selection(coordinates) => {
            independent = Some(coordinates.clone());
            PARTITIONING
        }
        Projection::Basis(rows) => {
            numbers.extend_from_slice(rows);
            TANGENT_PLANE
        }
        Projection::Relative(relatives) => {
            numbers.extend(relatives.references.iter().flatten());
            for anchor in &relatives.anchors {
                numbers.extend(anchor.orientation.iter().chain(&anchor.x));
            }
            let text = |source: &Source| match *source {
                Source::Dependent => SourceText::Dependent,
                Source::Independent(k) => SourceText::Independent(k),
                Source::Driven(row, sign, constant) => SourceText::Driven(row, sign, constant),
            };
            tree = Some(TreeText {
                forms: relatives.forms.to_vec(),
                rows: relatives.rows.to_vec(),
                sources: relatives.sources.iter().map(|s| s.each_ref().map(text)).collect(),
                exact: relatives.exact,
                has_alternatives: relatives.has_alternatives,
                moves: relatives.moves,
            });
            TREE
        }
    };
    let forest = &chart.forest;
    let text = ChartText {
        parametrization: name.to_owned(),
        ndof: p.ndof,
        kept: p.kept.to_vec(),
        dropped: p.dropped.clone(),
        follows: chart.follows,
        own_axes: chart.own_axes,
        in_second_axes: chart.in_second_axes.clone(),
        independent,
        tree,
        forest: ForestText {
            edge: forest.edge.clone(),
            parent: forest.parent.clone(),
            order: forest.order.clone(),
            edges: forest.edges(),
        },
    };
    (serde_json::json!(text).to_string(), numbers)
}

/// A chart of text and numbers; `n` generalized coordinates.
fn decode(t: f64, text: &str, numbers: &[f64], n: usize) -> Option<ChartRecord> {
    let text: ChartText = serde_json::from_str(text).ok()?;
    let (q, rest) = numbers.split_at_checked(n)?;
    let projection = match (text.parametrization.as_str(), text.tree) {
        (PARTITIONING, _) => Projection::Selection(text.independent?),
        (TANGENT_PLANE, _) => Projection::Basis(rest.to_vec()),
        (TREE, Some(tree)) => {
            let (references, anchors) =
                rest.split_at_checked(rest.len().checked_sub(ANCHOR * tree.forms.len())?)?;
            let source = |source: SourceText| match source {
                SourceText::Dependent => Source::Dependent,
                SourceText::Independent(k) => Source::Independent(k),
                SourceText::Driven(row, sign, constant) => Source::Driven(row, sign, constant),
            };
            Projection::Relative(Box::new(Relatives {
                forms: tree.forms.into(),
                rows: tree.rows.into(),
                sources: tree.sources.into_iter().map(|s| s.map(source)).collect(),
                references: references.as_chunks::<REFERENCE>().0.to_vec(),
                anchors: (anchors.as_chunks::<ANCHOR>().0.iter())
                    .map(|&[a, b, c, d, ref x @ ..]| Anchor { orientation: [a, b, c, d], x: *x })
                    .collect(),
                exact: tree.exact,
                has_alternatives: tree.has_alternatives,
                moves: tree.moves,
            }))
        }
        _ => return None,
    };
    let ForestText { edge, parent, order, edges } = text.forest;
    Some(ChartRecord {
        t,
        q: q.to_vec(),
        forest: Forest::known(edge, parent, order, edges)?,
        parametrization: Parametrization {
            kept: text.kept.into(),
            dropped: text.dropped,
            projection,
            ndof: text.ndof,
            pivot_ratio: 1.0,
        },
        follows: text.follows,
        own_axes: text.own_axes,
        in_second_axes: text.in_second_axes,
    })
}

/// Steps that are none of this model.
fn foreign(message: &str) -> PyErr {
    SimulationError::new_err(report::refusal("simulation/dense-output", message, None, ""))
}

/// Steps as a dictionary of arrays, with `charts`: a list of (t, text, numbers).
pub(crate) fn to_python<'py>(py: Python<'py>, steps: &Segments) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, values) in [
        ("t", &steps.t),
        ("h", &steps.h),
        ("q", &steps.q),
        ("winding", &steps.winding),
        ("normals", &steps.normals),
        ("ledger", &steps.ledger),
        ("powers", &steps.powers),
        ("w", &steps.w),
    ] {
        dict.set_item(name, PyArray1::from_slice(py, values))?;
    }
    for (name, values) in [("chart", &steps.chart), ("degree", &steps.degree)] {
        let values = values.iter().map(|&x| x as f64);
        dict.set_item(name, PyArray1::from_iter(py, values))?;
    }
    dict.set_item("end", steps.end)?;
    dict.set_item("dimension", steps.dimension)?;
    dict.set_item("charts_before", steps.charts_before)?;
    let charts = PyList::empty(py);
    for chart in &steps.charts {
        let (text, numbers) = encode(chart);
        charts.append((chart.t, text, PyArray1::from_slice(py, &numbers)))?;
    }
    dict.set_item("charts", charts)?;
    Ok(dict)
}

/// Steps of a dictionary as [`to_python`] makes it.
pub(crate) fn from_python(dict: &Bound<'_, PyDict>) -> PyResult<Segments> {
    let item = |name: &str| {
        dict.get_item(name)?.ok_or_else(|| foreign(&format!("the steps have no entry `{name}`")))
    };
    let numbers = |name: &str| -> PyResult<Vec<f64>> {
        Ok(item(name)?.extract::<PyReadonlyArrayDyn<'_, f64>>()?.as_slice()?.to_vec())
    };
    let mut steps = Segments::default();
    for (name, values) in [
        ("t", &mut steps.t),
        ("h", &mut steps.h),
        ("q", &mut steps.q),
        ("winding", &mut steps.winding),
        ("normals", &mut steps.normals),
        ("ledger", &mut steps.ledger),
        ("powers", &mut steps.powers),
        ("w", &mut steps.w),
    ] {
        *values = numbers(name)?;
    }
    for (name, values) in [("chart", &mut steps.chart), ("degree", &mut steps.degree)] {
        *values = numbers(name)?.into_iter().map(|x| x as usize).collect();
    }
    steps.end = item("end")?.extract()?;
    steps.dimension = item("dimension")?.extract()?;
    steps.charts_before = item("charts_before")?.extract()?;
    let n = steps.q.len() / steps.t.len().max(1);
    for chart in item("charts")?.try_iter()? {
        let (t, text, values): (f64, String, PyReadonlyArrayDyn<'_, f64>) = chart?.extract()?;
        let record = decode(t, &text, values.as_slice()?, n)
            .ok_or_else(|| foreign("the stored steps have a chart that cannot be read"))?;
        steps.charts.push(record);
    }
    Ok(steps)
}
