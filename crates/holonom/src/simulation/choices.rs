//! What is stated of a run, and what becomes of it: the call first, then the model file, then defaults.

use super::checks::{NOT_NEWMARK, RunError};
use super::options::{Options, OutputTimes};
use crate::error::printable;
use crate::method::{CODES, Code, Newmark, Profile};
use crate::model::{Model, Tolerance};
use crate::newton::{JacobianSource, Representation};
use crate::reduction::accelerations::Accelerations;
use crate::reduction::{Coordinates, ParametrizationKind};
use crate::threads::Threads;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeSet;

const MOST_THREADS: usize = 1024;
/// The family of a formula that is stated without one.
const FAMILY: &str = "first_order";
/// 2⁵³: beyond, not every whole number is one of 64 bits of a file.
const LARGEST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// Choices stated for a run, by the names of options; what is absent comes from the model, or is a default.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "the fields are those of `Options` and of the model file")]
pub struct Choices {
    pub start_time: Option<f64>,
    pub end_time: Option<f64>,
    pub tolerance: ToleranceParts,
    pub method: Option<String>,
    pub formula: Option<String>,
    pub interval: Option<f64>,
    pub output_times: Option<Vec<f64>>,
    pub channels: Option<Vec<String>>,
    pub fixed_step: Option<f64>,
    pub max_step: Option<f64>,
    pub initial_step: Option<f64>,
    #[serde(deserialize_with = "whole")]
    pub max_steps: Option<u64>,
    pub max_seconds: Option<f64>,
    pub parametrization: Option<String>,
    pub jacobian: Option<String>,
    pub newton: Option<String>,
    pub accelerations: Option<String>,
    pub coordinates: Option<String>,
    #[serde(deserialize_with = "whole")]
    pub threads: Option<usize>,
    pub repartition_factor: Option<f64>,
    pub dense_output: Option<bool>,
    pub profile: Option<String>,
    pub newmark_gamma: Option<f64>,
    pub newmark_beta: Option<f64>,
}

/// Parts of a tolerance that are stated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "the fields are those of `Tolerance`")]
pub struct ToleranceParts {
    pub relative: Option<f64>,
    pub translation: Option<f64>,
    pub rotation: Option<f64>,
}

/// A word of a method that names none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownWord {
    /// The option, `method` or `formula`.
    pub option: &'static str,
    /// What it was given.
    pub word: String,
    /// The words it knows; of a formula, those of the method.
    pub known: Vec<&'static str>,
}

/// The word by which a stated method or formula is none that there is, if so.
pub fn unknown_method(method: Option<&str>, formula: Option<&str>) -> Option<UnknownWord> {
    let named = method.unwrap_or(FAMILY);
    if Code::find(named, None).is_err() {
        let codes = CODES.iter().map(|info| info.name);
        let mut known: Vec<&str> = codes.chain(CODES.iter().map(|info| info.family)).collect();
        let mut seen = BTreeSet::new();
        known.retain(|&name| seen.insert(name));
        return Some(UnknownWord { option: "method", word: named.to_owned(), known });
    }
    let word = formula.filter(|formula| Code::find(named, Some(formula)).is_err())?;
    let formulas = CODES.iter().map(|info| info.formula);
    let known = formulas.filter(|formula| Code::find(named, Some(formula)).is_ok());
    let mut seen = BTreeSet::new();
    let known = known.filter(|&formula| seen.insert(formula)).collect();
    Some(UnknownWord { option: "formula", word: word.to_owned(), known })
}

impl Choices {
    /// First time of a run, s: that of the state it starts from, if it does.
    ///
    /// # Errors
    /// [`RunError::StartTime`] when another one is stated.
    pub fn start_time(&self, model: &Model, from: Option<f64>) -> Result<f64, RunError> {
        match (self.start_time, from) {
            (Some(stated), Some(from)) if stated != from => {
                Err(RunError::StartTime { stated, from })
            }
            (stated, from) => {
                Ok(from.or(stated).or(model.simulation.start_time).unwrap_or_default())
            }
        }
    }

    /// The tolerance of a run.
    pub fn tolerance(&self, model: &Model) -> Tolerance {
        let otherwise = model.simulation.tolerance.unwrap_or_default();
        Tolerance {
            relative: self.tolerance.relative.unwrap_or(otherwise.relative),
            translation: self.tolerance.translation.unwrap_or(otherwise.translation),
            rotation: self.tolerance.rotation.unwrap_or(otherwise.rotation),
        }
    }

    /// Options of a run of `model` from `start`, s.
    ///
    /// # Errors
    /// [`RunError`] when a word is not known, or nothing says when the run ends.
    pub fn resolve(&self, model: &Model, start: f64) -> Result<Options, RunError> {
        let file = &model.simulation;
        let end_time = self.end_time.or(file.end_time).ok_or(RunError::NoEndTime)?;
        let usual = Options::new(end_time);
        // A method of the call replaces the file's pair, not half of it.
        let (method, formula) = match &self.method {
            Some(method) => (Some(method), self.formula.as_deref()),
            None => (
                file.method.as_ref(),
                self.formula.as_ref().or(file.formula.as_ref()).map(String::as_str),
            ),
        };
        let code = match (method, formula) {
            (None, None) => usual.code,
            _ => Code::find(method.map_or(FAMILY, String::as_str), formula)?,
        };
        // Nor are steps of the call controlled by what the file says of others.
        let controlled = self.max_step.or(self.initial_step).is_some();
        let [max_step, initial_step] = [file.max_step, file.initial_step]
            .map(|step| step.filter(|_| self.fixed_step.is_none()));
        let profile = word("profile", self.profile.as_ref(), Profile::ALL)?;
        let profile = profile.or(file.profile).unwrap_or(usual.profile);
        let parametrization =
            word("parametrization", self.parametrization.as_ref(), ParametrizationKind::ALL)?;
        let jacobian = word("jacobian", self.jacobian.as_ref(), JacobianSource::ALL)?;
        let newton = word("newton", self.newton.as_ref(), Representation::ALL)?;
        let accelerations = word("accelerations", self.accelerations.as_ref(), Accelerations::ALL)?;
        let coordinates = word("coordinates", self.coordinates.as_ref(), Coordinates::ALL)?;
        let threads = self.threads.unwrap_or(1);
        if !(1..=MOST_THREADS).contains(&threads) {
            let rule = "from 1 to 1024";
            return Err(RunError::Option { option: "threads", value: threads as f64, rule });
        }
        if !code.is_trapezoidal() {
            let options =
                [("newmark_gamma", self.newmark_gamma), ("newmark_beta", self.newmark_beta)];
            if let Some((option, value)) = options.into_iter().find_map(|(o, v)| Some((o, v?))) {
                return Err(RunError::Option { option, value, rule: NOT_NEWMARK });
            }
        }
        let newmark = self.newmark_gamma.or(self.newmark_beta).map(|_| {
            let newmark = Newmark::damping(self.newmark_gamma.unwrap_or(0.5));
            Newmark { beta: self.newmark_beta.unwrap_or(newmark.beta), ..newmark }
        });
        let interval = self.interval.or(model.outputs.interval);
        let output = match (&self.output_times, interval) {
            (Some(times), _) => OutputTimes::Listed(times.clone()),
            (None, Some(interval)) => OutputTimes::Interval(interval),
            (None, None) => OutputTimes::between(start, end_time),
        };
        Ok(Options {
            end_time,
            tolerance: self.tolerance(model),
            code,
            profile,
            output,
            channels: self.channels.as_ref().unwrap_or(&model.outputs.channels).clone(),
            fixed_step: self.fixed_step.or(file.fixed_step.filter(|_| !controlled)),
            max_step: self.max_step.or(max_step).unwrap_or(usual.max_step),
            initial_step: self.initial_step.or(initial_step),
            max_steps: self.max_steps.or(file.max_steps).unwrap_or(usual.max_steps),
            max_seconds: self.max_seconds.or(file.max_seconds).unwrap_or(usual.max_seconds),
            checkpoint_steps: usual.checkpoint_steps,
            newmark,
            parametrization: parametrization
                .or(file.parametrization)
                .unwrap_or(profile.parametrization()),
            jacobian: jacobian.or(file.jacobian).unwrap_or(usual.jacobian),
            newton: newton.or(file.newton).unwrap_or(usual.newton),
            accelerations: accelerations.or(file.accelerations).unwrap_or(usual.accelerations),
            coordinates: coordinates.or(file.coordinates).unwrap_or(usual.coordinates),
            threads: Threads::new(threads),
            repartition_factor: self.repartition_factor.or(file.repartition_factor),
            dense_output: self.dense_output.or(file.dense_output),
        })
    }

    /// Options with which a model is checked: those of its file. Where that states no end, the run ends at
    /// once.
    ///
    /// # Errors
    /// As [`Choices::resolve`].
    pub fn of_file(model: &Model) -> Result<Options, RunError> {
        let start = model.simulation.start_time.unwrap_or_default();
        let end_time = model.simulation.end_time.or(Some(start));
        Self { end_time, ..Self::default() }.resolve(model, start)
    }

    /// Options of a run from `start`, s, as choices that state all of them.
    pub fn of(options: &Options, start: f64) -> Self {
        let Tolerance { relative, translation, rotation } = options.tolerance;
        let (interval, output_times) = match &options.output {
            OutputTimes::Interval(interval) => (Some(*interval), None),
            OutputTimes::Listed(times) => (None, Some(times.clone())),
        };
        let finite = |limit: f64| Some(limit).filter(|limit| limit.is_finite());
        let info = options.code.info();
        Self {
            start_time: Some(start),
            end_time: Some(options.end_time),
            tolerance: ToleranceParts {
                relative: Some(relative),
                translation: Some(translation),
                rotation: Some(rotation),
            },
            method: Some(info.name.into()),
            formula: Some(info.formula.into()),
            interval,
            output_times,
            channels: Some(options.channels.clone()),
            fixed_step: options.fixed_step,
            max_step: finite(options.max_step),
            initial_step: options.initial_step,
            max_steps: Some(options.max_steps),
            max_seconds: finite(options.max_seconds),
            parametrization: Some(options.parametrization.name().into()),
            jacobian: Some(options.jacobian.name().into()),
            newton: Some(options.newton.name().into()),
            accelerations: Some(options.accelerations.name().into()),
            coordinates: Some(options.coordinates.name().into()),
            threads: Some(options.threads.count()),
            repartition_factor: Some(options.repartition_factor()),
            dense_output: Some(options.stores_dense_output()),
            profile: Some(options.profile.name().into()),
            newmark_gamma: options.newmark.map(|newmark| newmark.gamma),
            newmark_beta: options.newmark.map(|newmark| newmark.beta),
        }
    }
}

/// A whole number that is not negative, in the words of people.
fn whole<'de, D, T>(from: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: TryFrom<u64>,
{
    let Some(number) = Option::<serde_json::Number>::deserialize(from)? else { return Ok(None) };
    let whole =
        |x: f64| (x.fract() == 0.0 && (0.0..=LARGEST_WHOLE).contains(&x)).then_some(x as u64);
    let value = number.as_u64().or_else(|| number.as_f64().and_then(whole));
    let value = value.and_then(|value| T::try_from(value).ok());
    value.map(Some).ok_or_else(|| {
        D::Error::custom(format!("{number} is no whole number from 0 up to {LARGEST_WHOLE}"))
    })
}

/// What a word stated for an option means.
fn word<T: Copy>(
    option: &'static str,
    stated: Option<&String>,
    all: &[(T, &'static str)],
) -> Result<Option<T>, RunError> {
    let meant = |word: &str| {
        let known = || all.iter().map(|entry| entry.1).collect::<Vec<_>>().join(", ");
        let found = all.iter().find(|entry| entry.1 == word).map(|entry| entry.0);
        found.ok_or_else(|| RunError::Word { option, word: printable(word), known: known() })
    };
    stated.map(|word| meant(word)).transpose()
}
