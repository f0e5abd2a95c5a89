//! What the windows so far have shown of each fault of one actuator.

use ema_models::FaultId;

use super::Health;
use crate::health::HealthState;

/// Damage of a fault by the newest window that shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Damage, 0…1.
    pub damage: f64,
    /// Its standard deviation; `None` where the record has none.
    pub sigma: Option<f64>,
    /// Start of that window, UTC ns.
    pub t_start_ns: u64,
}

/// The newest damage of each fault. A window that does not show a fault leaves it as it was; a fault that is
/// unknown again, by a replacement or a doubt, is forgotten.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LastShown([Option<Shown>; FaultId::COUNT]);

impl LastShown {
    /// Takes the next window of the actuator.
    pub fn update(&mut self, health: &Health) {
        let states = health.states().unwrap_or_else(|| {
            // Records of older versions have the state of the actuator alone.
            [HealthState::named(&health.health); FaultId::COUNT]
        });
        let (damages, sigmas) = (health.damages(), health.damage_sigmas());
        for (n, shown) in self.0.iter_mut().enumerate() {
            if states[n] == HealthState::Unknown {
                *shown = None;
            } else if let Some(damage) = damages[n] {
                *shown = Some(Shown {
                    damage,
                    sigma: sigmas[n],
                    t_start_ns: health.t_start_ns,
                });
            }
        }
    }

    /// Forgets what is known of a fault.
    pub(crate) fn forget(&mut self, fault: FaultId) {
        self.0[fault.index()] = None;
    }

    /// What is known of a fault; `None` where no window has shown it.
    #[must_use]
    pub fn of(&self, fault: FaultId) -> Option<Shown> {
        self.0[fault.index()]
    }

    /// The damages, in the order of [`FaultId::ALL`].
    #[must_use]
    pub fn damages(&self) -> [Option<f64>; FaultId::COUNT] {
        self.0.map(|shown| shown.map(|shown| shown.damage))
    }

    /// The same, with what earlier windows have shown of the faults that it does not know.
    #[must_use]
    pub fn or(self, earlier: &Self, counts: impl Fn(FaultId) -> bool) -> Self {
        Self(FaultId::ALL.map(|fault| self.of(fault).or(earlier.of(fault).filter(|_| counts(fault)))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(n: u64, states: [HealthState; 2], damages: [Option<f64>; 2]) -> Health {
        let mut health = Health {
            t_start_ns: n,
            k1_sigma: Some(0.01),
            ..Health::default()
        };
        let mut all = [HealthState::Nominal; FaultId::COUNT];
        let mut damage = [None; FaultId::COUNT];
        all[..2].copy_from_slice(&states);
        damage[..2].copy_from_slice(&damages);
        health.set_states(&all);
        health.set_damage(damage);
        health
    }

    #[test]
    fn a_fault_keeps_what_was_shown_of_it_until_it_begins_anew() {
        use HealthState::{Nominal, Unknown, Watch};
        let mut shown = LastShown::default();
        shown.update(&window(1, [Watch, Unknown], [Some(0.1), None]));
        shown.update(&window(2, [Watch, Nominal], [None, Some(0.02)]));
        let friction = Shown {
            damage: 0.1,
            sigma: Some(0.01),
            t_start_ns: 1,
        };
        assert_eq!(shown.of(FaultId::Friction), Some(friction));
        assert_eq!(shown.damages()[..3], [Some(0.1), Some(0.02), None]);
        let before = shown;
        shown.update(&window(3, [Unknown, Nominal], [None, None]));
        assert_eq!(shown.damages()[..2], [None, Some(0.02)]);
        assert_eq!(shown.or(&before, |_| true), before);
        assert_eq!(shown.or(&before, |_| false), shown);
    }

    #[test]
    fn an_older_record_forgets_all_with_its_state() {
        let old = |health: &str, damage| {
            let mut record = Health {
                health: health.to_owned(),
                ..Health::default()
            };
            record.set_damage([damage; FaultId::COUNT]);
            record
        };
        let mut shown = LastShown::default();
        shown.update(&old("watch", Some(0.2)));
        shown.update(&old("watch", None));
        assert_eq!(shown.damages(), [Some(0.2); FaultId::COUNT]);
        shown.update(&old("unknown", Some(0.2)));
        assert_eq!(shown, LastShown::default());
    }
}
