//! One table per message: `message!` makes the prost struct and its descriptor from the same lines.
//!
//! The descriptor is what an independent reader decodes with, so it must not drift from what is encoded. There is no
//! `protoc` in the build, and no second copy of the field list.

use prost_types::descriptor_proto::ReservedRange;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, OneofDescriptorProto,
};

/// Package of every message that is defined here.
pub const PACKAGE: &str = "hmd.v1";

/// Declares a record: fields as `name: RustType = tag kind [label];`, kinds and labels in protobuf's words.
///
/// A Rust type that does not fit the kind fails to compile inside prost's derive. `reserved tag "name"` behind the struct's
/// name is a field that older files may have: neither its number nor its name is given again.
macro_rules! message {
    (
        $(#[$meta:meta])*
        pub struct $name:ident $(reserved $gone_tag:literal $gone:literal)* {
            $( $(#[$field_meta:meta])* $field:ident: $rust:ty = $tag:tt $kind:ident $($label:ident)?; )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, PartialEq, ::prost::Message)]
        pub struct $name {
            $( $(#[$field_meta])* #[prost($kind $(, $label)?, tag = $tag)] pub $field: $rust, )*
        }

        impl $name {
            fn file_descriptor_set() -> ::prost_types::FileDescriptorSet {
                $crate::record::schema::descriptor_set(stringify!($name), &[
                    $( ($tag, stringify!($field), stringify!($kind), concat!($(stringify!($label))?)), )*
                ], &[$( ($gone_tag, $gone) ),*])
            }
        }
    };
}
pub(crate) use message;

/// The descriptor of one message in its own file; `fields` are tag, name, kind and label (or an empty string), `reserved` the
/// tags and names of fields that are gone.
///
/// # Panics
/// On a kind or label that the table cannot have; every record's descriptor is built in a test.
pub(crate) fn descriptor_set(
    name: &str,
    fields: &[(i32, &str, &str, &str)],
    reserved: &[(i32, &str)],
) -> FileDescriptorSet {
    let range = |&(tag, _): &(i32, &str)| ReservedRange {
        start: Some(tag),
        end: Some(tag + 1),
    };
    let mut message = DescriptorProto {
        name: Some(name.to_owned()),
        reserved_range: reserved.iter().map(range).collect(),
        reserved_name: reserved.iter().map(|(_, name)| (*name).to_owned()).collect(),
        ..Default::default()
    };
    for &(tag, field, kind, label) in fields {
        let mut descriptor = FieldDescriptorProto {
            name: Some(field.to_owned()),
            number: Some(tag),
            label: Some(if label == "repeated" {
                Label::Repeated
            } else {
                Label::Optional
            } as i32),
            r#type: Some(field_type(kind) as i32),
            ..Default::default()
        };
        match label {
            "" | "repeated" => {}
            // proto3 tells "absent" from "zero" by a oneof of one field.
            "optional" => {
                descriptor.proto3_optional = Some(true);
                descriptor.oneof_index = Some(message.oneof_decl.len() as i32);
                message.oneof_decl.push(OneofDescriptorProto {
                    name: Some(format!("_{field}")),
                    options: None,
                });
            }
            other => unreachable!("label {other} in the table of {name}"),
        }
        message.field.push(descriptor);
    }
    let file = FileDescriptorProto {
        name: Some(format!("hmd/v1/{name}.proto")),
        package: Some(PACKAGE.to_owned()),
        message_type: vec![message],
        syntax: Some("proto3".to_owned()),
        ..Default::default()
    };
    FileDescriptorSet { file: vec![file] }
}

fn field_type(kind: &str) -> Type {
    match kind {
        "bool" => Type::Bool,
        "bytes" => Type::Bytes,
        "double" => Type::Double,
        "float" => Type::Float,
        "sint64" => Type::Sint64,
        "string" => Type::String,
        "uint32" => Type::Uint32,
        "uint64" => Type::Uint64,
        other => unreachable!("kind {other} is not in the table"),
    }
}
