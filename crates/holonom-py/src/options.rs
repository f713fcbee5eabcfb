//! Options of a run: those of the call, then those of the model file, then defaults.

use holonom::method::{Code, Newmark, Profile};
use holonom::model::{Model, Tolerance};
use holonom::newton::JacobianSource;
use holonom::reduction::Choice;
use holonom::simulation::{Options, OutputTimes};
use serde::Deserialize;

/// Choices of one call; what is absent comes from the model.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Choices {
    start_time: Option<f64>,
    end_time: Option<f64>,
    tolerance: Option<Parts>,
    method: Option<String>,
    formula: Option<String>,
    interval: Option<f64>,
    output_times: Option<Vec<f64>>,
    channels: Option<Vec<String>>,
    fixed_step: Option<f64>,
    max_step: Option<f64>,
    initial_step: Option<f64>,
    max_steps: Option<u64>,
    max_seconds: Option<f64>,
    parametrization: Option<String>,
    jacobian: Option<String>,
    repartition_factor: Option<f64>,
    dense_output: Option<bool>,
    profile: Option<String>,
    newmark_gamma: Option<f64>,
    newmark_beta: Option<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Parts {
    relative: f64,
    translation: f64,
    rotation: f64,
}

/// Why choices cannot be used: code and message.
pub(crate) type Refusal = (&'static str, String);

impl Choices {
    pub(crate) fn start_time(&self) -> Option<f64> {
        self.start_time
    }

    /// Options of the run; `start` is its first time.
    pub(crate) fn resolve(self, model: &Model, start: f64) -> Result<Options, Refusal> {
        let file = &model.simulation;
        let Some(end_time) = self.end_time.or(file.end_time) else {
            let message = "no `end_time`: state it in the call or under [simulation]".into();
            return Err(("simulation/option", message));
        };
        let mut options = Options::new(end_time);
        if let Some(tolerance) = self
            .tolerance
            .map(|p| Tolerance {
                relative: p.relative,
                translation: p.translation,
                rotation: p.rotation,
            })
            .or(file.tolerance)
        {
            options.tolerance = tolerance;
        }
        // A method of the call replaces the file's pair, not half of it.
        let (method, formula) = if self.method.is_some() {
            (self.method, self.formula)
        } else {
            (file.method.clone(), self.formula.or(file.formula.clone()))
        };
        if method.is_some() || formula.is_some() {
            let family = method.as_deref().unwrap_or("first_order");
            options.code = Code::find(family, formula.as_deref())
                .map_err(|e| ("simulation/unknown-method", e.to_string()))?;
        }
        if let Some(name) = self.profile.as_deref().or(file.profile) {
            let known = Profile::NAMES.iter().find(|(known, _)| *known == name);
            options.profile = known.map(|(_, profile)| *profile).ok_or_else(|| {
                let message = format!("unknown profile `{name}`; known are improved and thesis");
                ("simulation/option", message)
            })?;
        }
        options.parametrization = options.profile.parametrization();
        if let Some(name) = self.parametrization.as_deref().or(file.parametrization) {
            options.parametrization = Choice::find(name).ok_or_else(|| {
                unknown("parametrization", name, Choice::ALL.iter().map(|(_, n)| *n))
            })?;
        }
        if let Some(name) = self.jacobian.as_deref().or(file.jacobian) {
            options.jacobian = JacobianSource::find(name).ok_or_else(|| {
                unknown("jacobian", name, JacobianSource::ALL.iter().map(|(_, n)| *n))
            })?;
        }
        options.newmark = match (self.newmark_gamma, self.newmark_beta) {
            (None, None) => None,
            (gamma, beta) => {
                let newmark = Newmark::damping(gamma.unwrap_or(0.5));
                Some(Newmark { beta: beta.unwrap_or(newmark.beta), ..newmark })
            }
        };
        options.output = match (self.output_times, self.interval.or(model.outputs.interval)) {
            (Some(times), _) => OutputTimes::Listed(times),
            (None, Some(interval)) => OutputTimes::Interval(interval),
            (None, None) if end_time > start => {
                OutputTimes::Interval((end_time - start) / DEFAULT_OUTPUTS)
            }
            (None, None) => OutputTimes::Listed(vec![start]),
        };
        options.channels = self.channels.unwrap_or_else(|| model.outputs.channels.clone());
        options.fixed_step = self.fixed_step.or(file.fixed_step);
        options.max_step = self.max_step.or(file.max_step).unwrap_or(options.max_step);
        options.initial_step = self.initial_step.or(file.initial_step);
        options.max_steps = self.max_steps.or(file.max_steps).unwrap_or(options.max_steps);
        options.max_seconds = self.max_seconds.or(file.max_seconds).unwrap_or(options.max_seconds);
        options.repartition_factor = self
            .repartition_factor
            .or(file.repartition_factor)
            .unwrap_or(options.repartition_factor);
        options.dense_output = self.dense_output.or(file.dense_output);
        Ok(options)
    }
}

fn unknown(option: &str, name: &str, known: impl Iterator<Item = &'static str>) -> Refusal {
    let known = known.collect::<Vec<_>>().join(", ");
    ("simulation/option", format!("unknown {option} `{name}`; known are {known}"))
}

/// Output rows when no interval is stated.
pub(crate) const DEFAULT_OUTPUTS: f64 = 200.0;
