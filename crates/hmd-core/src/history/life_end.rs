//! What ends the life by a forecast, and whether a new part makes that void.

use ema_models::FaultId;

use super::ReplacedPart;
use super::functional::LimitingCriterion;
use crate::record::Rul;

/// What ends the life by a forecast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LifeEnd {
    /// Whether it is a requirement, which all faults together miss.
    pub by_function: bool,
    /// The fault whose trend is the first to end; `None` where that is not known.
    pub fault: Option<FaultId>,
}

impl LifeEnd {
    /// By the forecast of a record; `None` where it has no hours: the fault that it names then has the largest damage, and ends nothing.
    #[must_use]
    pub fn of(rul: &Rul) -> Option<Self> {
        rul.rul_p10_h?;
        Some(Self {
            by_function: !["", LimitingCriterion::Damage.name()].contains(&&*rul.governed_by),
            fault: FaultId::from_name(&rul.dominant_fault),
        })
    }

    /// Whether a new part, or unit (`None`), takes this end away: one of the part whose fault it is, and any where all faults together
    /// end the life. Where nothing says which fault it is, another unit alone does.
    #[must_use]
    pub fn is_of(&self, part: Option<ReplacedPart>) -> bool {
        let is_of_fault = || self.fault.is_some_and(|fault| ReplacedPart::renews(part, fault));
        part.is_none() || self.by_function || is_of_fault()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_takes_the_end_by_its_own_faults_and_any_takes_that_by_the_function() {
        let end = |governed_by: &str, fault: &str| {
            let rul = Rul {
                rul_p10_h: Some(1.0),
                governed_by: governed_by.to_owned(),
                dominant_fault: fault.to_owned(),
                ..Rul::default()
            };
            let end = LifeEnd::of(&rul).expect("hours");
            [
                None,
                Some(ReplacedPart::Motor),
                Some(ReplacedPart::Gearbox),
                Some(ReplacedPart::Controller),
            ]
            .map(|part| end.is_of(part))
        };
        assert_eq!(end("damage", "friction"), [true, true, true, false]);
        assert_eq!(end("damage", "backlash"), [true, false, true, false]);
        assert_eq!(end("", ""), [true, false, false, false]);
        for fault in ["gain", ""] {
            assert_eq!(end("slew_rate", fault), [true; 4]);
        }
        assert_eq!(LifeEnd::of(&Rul::default()), None);
    }
}
