//! One simulated window as a problem for other minimisers: costs and residuals of the monitor, and our own estimate.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, comparison};
use ema_models::{
    ActuatorParams, COST_LANES, Calibration, Comparison, Coordinates, FAULT_COUNT, FaultVector, MotorKnowledge,
    Profile, RANK_LANES, Scale, Tolerances, UNKNOWN_COUNT, Unknowns, rss_pct,
};
use hmd_core::assess::method;
use hmd_core::config::{IdentificationConfig, SearchMethod};
use hmd_lab::calibrate_type::random_faults;
use hmd_lab::simulated::SimulatedWindow;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::{misuse, raised};

/// Unknowns of a window whose motor is known: eight faults, load, integral.
const OPEN: usize = UNKNOWN_COUNT - 2;

/// A window of `bench` with a random fault vector, mixed profile, 2 kHz, no noise, and the monitor that it is compared with. Vectors
/// of unknowns are `[k1…k5, ζ cos φ, ζ sin φ, k8, load, integral]` in the units of the search. Everything runs on one thread.
#[pyclass(frozen)]
pub(crate) struct FitProblem {
    identifier: Identifier,
    coefficients: Calibration,
    window: SimulatedWindow,
    thread: rayon::ThreadPool,
}

#[pymethods]
impl FitProblem {
    /// The window of a number; the same number gives the same window.
    #[new]
    fn new(number: u64) -> PyResult<Self> {
        let params = ActuatorParams::bench();
        let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase)
            .unwrap_or_else(|| TypeCalibration::uncalibrated("bench", MonitorForm::ThreePhase, &params));
        let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        Ok(Self {
            coefficients: calibration.coefficients(),
            identifier: Identifier {
                params,
                calibration,
                method: method(&IdentificationConfig::default()),
                motor: MotorKnowledge::default(),
                tolerances: Tolerances::NONE,
            },
            window: SimulatedWindow::new(
                &params,
                random_faults(TRUTHS + number),
                Profile::Mixed,
                WINDOWS + number,
            ),
            thread: thread.map_err(raised)?,
        })
    }

    /// Lower and upper bounds of the unknowns.
    #[staticmethod]
    fn bounds() -> (Vec<f64>, Vec<f64>) {
        (Coordinates::LOWER[..OPEN].to_vec(), Coordinates::UPPER[..OPEN].to_vec())
    }

    /// The healthy actuator.
    fn healthy(&self) -> Vec<f64> {
        let nominal = self.comparison().unknowns_with_fault(FaultVector::NOMINAL);
        self.scale().coordinates(&nominal).0[..OPEN].to_vec()
    }

    /// Costs of fault vectors k, a row each, in single precision as our own populations rank them; 64-bit numbers.
    fn fault_costs<'py>(&self, py: Python<'py>, faults: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
        let rows = rows::<FAULT_COUNT>(py, faults)?;
        let costs: Vec<f64> = py.detach(|| {
            let comparison = self.comparison();
            let unknowns = |k: &[f64; FAULT_COUNT]| comparison.unknowns_with_fault(FaultVector::from_array(*k));
            let of_chunk = |chunk: &[[f64; FAULT_COUNT]]| {
                let lanes: [Unknowns; RANK_LANES] = in_lanes(chunk, unknowns);
                comparison.rank(&lanes)[..chunk.len()].to_vec()
            };
            rows.chunks(RANK_LANES).flat_map(of_chunk).collect()
        });
        Ok(bytes(py, &costs))
    }

    /// Costs of vectors of unknowns, a row each, in double precision: half the sum of the squares of `residuals`.
    fn costs<'py>(&self, py: Python<'py>, unknowns: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
        let rows = rows::<OPEN>(py, unknowns)?;
        let costs: Vec<f64> = py.detach(|| {
            let comparison = self.comparison();
            let of_chunk = |chunk: &[[f64; OPEN]]| {
                let lanes: [Coordinates; COST_LANES] = in_lanes(chunk, whole);
                comparison.costs(&lanes)[..chunk.len()].to_vec()
            };
            rows.chunks(COST_LANES).flat_map(of_chunk).collect()
        });
        Ok(bytes(py, &costs))
    }

    /// Weighted residuals of vectors of unknowns, a row each: five for each sample, and two of what is known beforehand.
    fn residuals<'py>(&self, py: Python<'py>, unknowns: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
        let rows = rows::<OPEN>(py, unknowns)?;
        let residuals: Vec<f64> = py.detach(|| {
            let comparison = self.comparison();
            rows.iter()
                .flat_map(|row| self.residuals_at(&comparison, row))
                .collect()
        });
        Ok(bytes(py, &residuals))
    }

    /// The fault vector k of unknowns.
    fn fault(&self, unknowns: Vec<f64>) -> PyResult<Vec<f64>> {
        let found: [f64; OPEN] = fixed(&unknowns)?;
        let at = whole(&found).projected_to_unit_disc();
        Ok(self.scale().unknowns(&at).fault.to_array().to_vec())
    }

    /// Error of a fault vector k, %: the root sum of squares of its components' errors.
    fn rss_pct(&self, k: Vec<f64>) -> PyResult<f64> {
        let k: [f64; FAULT_COUNT] = fixed(&k)?;
        Ok(rss_pct(&FaultVector::from_array(k), &self.window.truth))
    }

    /// Our own estimate by a method of the configuration: fault vector k and evaluations.
    fn identify(&self, py: Python<'_>, name: &str, seed: u64) -> PyResult<(Vec<f64>, u64)> {
        let found = SearchMethod::NAMES.into_iter().find(|(known, _)| *known == name);
        let (_, named) = found.ok_or_else(|| misuse(format!("method: expected one of hmd, found {name:?}")))?;
        let identifier = Identifier {
            method: method(&IdentificationConfig::for_method(named)),
            ..self.identifier.clone()
        };
        let estimate = py.detach(|| {
            let work = || identifier.identify(&self.window.prepared, self.window.conditions, seed);
            self.thread.install(work)
        });
        let estimate = estimate.map_err(raised)?;
        Ok((estimate.fault.to_array().to_vec(), estimate.evaluations))
    }
}

/// First seeds of the vectors and of the windows, which no calibration and no suite uses.
const TRUTHS: u64 = 70_000;
const WINDOWS: u64 = 80_000;

impl FitProblem {
    fn comparison(&self) -> Comparison<'_> {
        let own = &self.identifier;
        comparison(
            &self.window.prepared,
            &own.params,
            &self.coefficients,
            self.window.conditions,
            own.calibration.weights(own.params.sensors.sample_rate),
            own.motor,
        )
    }

    fn scale(&self) -> Scale {
        Scale::new(&self.identifier.params)
    }

    fn residuals_at(&self, comparison: &Comparison<'_>, row: &[f64; OPEN]) -> Vec<f64> {
        let (scale, at) = (self.scale(), whole(row));
        let weights = comparison.weights.to_array();
        let mut found = Vec::with_capacity(comparison.recording.samples.len() * weights.len() + 2);
        comparison.residuals(&scale.unknowns(&at), |_, residuals| {
            found.extend(residuals.to_array().iter().zip(weights).map(|(r, weight)| r * weight));
        });
        let nominal = comparison.unknowns_with_fault(FaultVector::NOMINAL);
        let sigma = scale.coordinates(&Unknowns {
            load_torque: comparison.prior.load_torque,
            integral: comparison.prior.integral,
            ..nominal
        });
        let expected = scale.coordinates(&nominal);
        found.extend((FAULT_COUNT..OPEN).map(|p| (at.0[p] - expected.0[p]) / sigma.0[p]));
        found
    }
}

/// The coordinates of open unknowns: the motor is of its type.
fn whole(row: &[f64; OPEN]) -> Coordinates {
    let mut at = [0.0; UNKNOWN_COUNT];
    at[..OPEN].copy_from_slice(row);
    Coordinates(at)
}

/// A value for each lane; those that a short chunk leaves over repeat its first.
fn in_lanes<T, const D: usize, const N: usize>(chunk: &[[f64; D]], of: impl Fn(&[f64; D]) -> T) -> [T; N] {
    std::array::from_fn(|lane| of(chunk.get(lane).unwrap_or(&chunk[0])))
}

/// The rows of an array of 64-bit numbers.
fn rows<const D: usize>(py: Python<'_>, array: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; D]>> {
    let numbers = PyBuffer::<f64>::get(array)?.to_vec(py)?;
    let (rows, rest) = numbers.as_chunks::<D>();
    if rest.is_empty() {
        Ok(rows.to_vec())
    } else {
        Err(misuse(format!(
            "expected rows of {D} numbers, found {} numbers",
            numbers.len()
        )))
    }
}

fn fixed<const D: usize>(numbers: &[f64]) -> PyResult<[f64; D]> {
    let found = numbers.len();
    let converted = numbers.try_into();
    converted.map_err(|_| misuse(format!("expected {D} numbers, found {found}")))
}

fn bytes<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyBytes> {
    let raw: Vec<u8> = numbers.iter().flat_map(|number| number.to_ne_bytes()).collect();
    PyBytes::new(py, &raw)
}
