//! A drive of CiA 402 on CANopen: PDO by its EDS or DCF, or overheard as they were written.
//!
//! Objects by CiA 402-2: 6041 statusword, 6061 mode display, 6062 position demand, 6063 and 6064 position, 6077 torque, 6078 current,
//! 6079 DC link voltage, 607A target position, 60E4 additional positions; scales 6075 rated current, 608F encoder resolution, 60E6 and
//! 60EB those of additional encoders.

use ema_models::ActuatorParams;

use super::eds::ObjectDictionary;
use super::layout::{Angles, Coding, DriveLayout, Field, Place};
use super::pdo::{self, Mapped, Pdo};
use super::{DriveMisfit, DriveSettings};
use crate::dbc::{ModeCodes, Role, SignalKind};
use crate::log_map::Quantity;

const STATUSWORD: u16 = 0x6041;
const MODE_DISPLAY: u16 = 0x6061;
const POSITION_DEMAND: u16 = 0x6062;
const POSITION: u16 = 0x6064;
const RATED_CURRENT: u16 = 0x6075;
const TORQUE: u16 = 0x6077;
const CURRENT: u16 = 0x6078;
const DC_LINK: u16 = 0x6079;
const TARGET_POSITION: u16 = 0x607A;
const ENCODER_RESOLUTION: u16 = 0x608F;
const ADDITIONAL_POSITION: u16 = 0x60E4;
const ADDITIONAL_INCREMENTS: u16 = 0x60E6;
const ADDITIONAL_TURNS: u16 = 0x60EB;

/// Bits of the statusword, and their values when the drive's operation is enabled.
const STATE_MASK: u64 = 0x6f;
const OPERATION_ENABLED: u64 = 0x27;

/// Modes that follow a position: profile position, interpolated position, cyclic synchronous position.
const POSITION_MODES: [u64; 3] = [1, 7, 8];

/// Differences after which positions of 16 and 32 bits begin again.
fn wraps(size: u16) -> f64 {
    f64::powi(2.0, i32::from(size))
}

pub(super) fn layout(
    settings: &DriveSettings,
    params: &ActuatorParams,
    dictionary: &ObjectDictionary,
) -> Result<DriveLayout, DriveMisfit> {
    let pdos = pdo::pdos(dictionary)?;
    let object = |index: u16, sub: u8| {
        let all = pdos.iter().flat_map(|pdo| &pdo.objects);
        all.into_iter().find(|of| of.index == index && of.sub == sub).copied()
    };
    let mut layout = DriveLayout::new();
    let motor_steps = settings
        .motor_units_per_rev
        .or_else(|| resolution(dictionary, (ENCODER_RESOLUTION, 1), (ENCODER_RESOLUTION, 2)))
        .ok_or(DriveMisfit::Unknown("motor_units_per_rev or object 608F"))?;
    let output = settings.output_encoder.map(|sub| sub as u8);
    let output_steps = match output {
        Some(sub) => settings
            .output_units_per_rev
            .or_else(|| resolution(dictionary, (ADDITIONAL_INCREMENTS, sub), (ADDITIONAL_TURNS, sub)))
            .ok_or(DriveMisfit::Unknown("output_units_per_rev or objects 60E6 and 60EB"))?,
        None => 1.0,
    };
    let demand = [POSITION_DEMAND, TARGET_POSITION]
        .into_iter()
        .find(|&index| object(index, 0).is_some());
    let settings = &DriveSettings {
        uses_commands: settings.uses_commands && demand.is_some(),
        ..settings.clone()
    };
    let of_demand = demand.map_or_else(String::new, |index| format!("{index:04X}"));
    let names = ["6064", &format!("60E4sub{}", output.unwrap_or(0)), &of_demand];
    let angles = Angles::add(&mut layout, settings, params, names, (motor_steps, output_steps));
    for (column, index, sub) in [
        (Some(angles.motor), POSITION, 0),
        (angles.output, ADDITIONAL_POSITION, output.unwrap_or(0)),
    ] {
        if let (Some(column), Some(mapped)) = (column, object(index, sub)) {
            layout.columns[column].wraps_after = Some(wraps(mapped.size));
        }
    }
    let (current, per_thousand) = current(settings, dictionary, &object)?;
    let name = format!("{current:04X}");
    let q = layout.column(Quantity::CurrentQ, &name, Some("A"), per_thousand);
    let voltage = layout.column(Quantity::Of(Role::DcLink), "6079", Some("mV"), 1.0);

    let modes = ModeCodes::default();
    let field = |mapped: &Mapped| {
        let place = |kind| Place::bits(kind, mapped.start, mapped.size);
        let (signed, unsigned) = (|| place(SignalKind::Signed), || place(SignalKind::Unsigned));
        match (mapped.index, mapped.sub) {
            _ if mapped.size == 0 => None,
            (POSITION, 0) => Some(Field::column(signed(), angles.motor)),
            (ADDITIONAL_POSITION, sub) if Some(sub) == output => Some(Field::column(signed(), angles.output?)),
            (index, 0) if index == current => Some(Field::column(signed(), q)),
            (DC_LINK, 0) => Some(Field::column(unsigned(), voltage)),
            (index, 0) if Some(index) == demand => Some(Field::command(signed(), angles.position?, modes.position)),
            (STATUSWORD, 0) => Some(Field::state(unsigned(), STATE_MASK, &[OPERATION_ENABLED])),
            (MODE_DISPLAY, 0) => Some(Field::state(unsigned(), 0xff, &POSITION_MODES)),
            _ => None,
        }
    };
    for Pdo {
        name,
        id,
        extended,
        synchronous,
        objects,
    } in &pdos
    {
        let fields: Vec<Field> = objects.iter().filter_map(field).collect();
        let end = objects.iter().map(|of| of.start + of.size).max().unwrap_or(0);
        if !fields.is_empty() {
            let length = usize::from(end.div_ceil(8));
            layout.message(name, *id, Some(*extended), Coding::Bits { length }, fields);
            if let Some(message) = layout.messages.last_mut() {
                message.synchronous = *synchronous;
            }
        }
    }
    let is_sent = |column: usize| {
        let fields = layout.messages.iter().flat_map(|message| &message.fields);
        fields
            .into_iter()
            .any(|field| field.target == super::layout::Target::Column(column))
    };
    if !is_sent(angles.motor) {
        return Err(DriveMisfit::Unknown("object 6064 in a PDO"));
    }
    match angles.output {
        Some(column) if !is_sent(column) => Err(DriveMisfit::Unknown("object 60E4 of output_encoder in a PDO")),
        _ => Ok(layout),
    }
}

/// The object of the current, and A of one thousandth.
fn current(
    settings: &DriveSettings,
    dictionary: &ObjectDictionary,
    object: &dyn Fn(u16, u8) -> Option<Mapped>,
) -> Result<(u16, f64), DriveMisfit> {
    // Rated currents are r.m.s. in mA.
    let rated = dictionary.number(RATED_CURRENT, 0).filter(|&rated| rated > 0);
    let of_file = rated.map(|rated| rated as f64 * 1e-3 * core::f64::consts::SQRT_2);
    if object(CURRENT, 0).is_some() {
        let rated = settings.rated_current_a.or(of_file);
        let rated = rated.ok_or(DriveMisfit::Unknown("rated_current_a or object 6075"))?;
        Ok((CURRENT, rated / 1000.0))
    } else if object(TORQUE, 0).is_some() {
        // A thousandth of the rated torque is one of its current.
        let rated = settings.rated_current_a;
        let rated = rated.ok_or(DriveMisfit::Unknown(
            "rated_current_a at rated torque, beside object 6077",
        ))?;
        Ok((TORQUE, rated / 1000.0))
    } else {
        Err(DriveMisfit::Unknown("object 6078 or 6077 in a PDO"))
    }
}

/// Steps in one turn: increments over turns.
fn resolution(dictionary: &ObjectDictionary, increments: (u16, u8), turns: (u16, u8)) -> Option<f64> {
    let increments = dictionary.number(increments.0, increments.1).filter(|&of| of > 0)?;
    let turns = dictionary.number(turns.0, turns.1).filter(|&of| of > 0).unwrap_or(1);
    Some(increments as f64 / turns as f64)
}
