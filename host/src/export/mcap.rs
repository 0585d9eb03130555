//! A recording as MCAP: JSON messages with schemas, one channel a kind of quantity.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions};
use serde_json::{Map, Value, json};

use super::{Channel, Column, Series};
use crate::recording::Recording;
use crate::robot::Robot;

/// Why no MCAP file was made.
#[derive(Debug, thiserror::Error)]
#[error("the MCAP file could not be made: {0}")]
pub struct McapError(#[from] mcap::McapError);

/// `recording` of `robot` as the bytes of an MCAP file.
///
/// Times are ns since tick 0. The metadata record `recording` holds what the manifest knows, seed included; the robot file
/// is attached as `robot.toml`.
pub fn recording_mcap(recording: &Recording, robot: &Robot) -> Result<Vec<u8>, McapError> {
    let series = Series::of(recording, robot);
    let options = WriteOptions::new().compression(None).library(crate::TOOL_VERSION);
    let mut writer = options.create(Cursor::new(Vec::new()))?;
    let mut channels = Vec::new();
    for channel in Channel::ALL {
        let columns: Vec<&Column> = series.columns.iter().filter(|column| column.channel == channel).collect();
        let schema = schema(channel, &series, &columns).to_string();
        let name = format!("armid{}", channel.topic().replace('/', "."));
        let schema = writer.add_schema(&name, "jsonschema", schema.as_bytes())?;
        let id = writer.add_channel(schema, channel.topic(), "json", &BTreeMap::new())?;
        channels.push((id, columns));
    }
    for (sample, &time_ns) in series.time_ns.iter().enumerate() {
        for (channel_id, columns) in &channels {
            let header = MessageHeader {
                channel_id: *channel_id,
                sequence: recording.tick[sample],
                log_time: time_ns,
                publish_time: time_ns,
            };
            writer.write_to_known_channel(&header, message(&series, columns, sample).to_string().as_bytes())?;
        }
    }
    writer.write_metadata(&Metadata { name: "recording".into(), metadata: metadata(recording, robot) })?;
    let robot_file = robot.to_toml();
    writer.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: "robot.toml".into(),
        media_type: "application/toml".into(),
        data: robot_file.as_bytes().into(),
    })?;
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

fn joint_key(series: &Series, joint: usize) -> String {
    format!("joint_{}", series.joints[joint])
}

fn message(series: &Series, columns: &[&Column], sample: usize) -> Value {
    let mut message = Map::new();
    for column in columns {
        let joint = message.entry(joint_key(series, column.joint)).or_insert_with(|| json!({}));
        joint[&column.quantity] = json!(column.values[sample]);
    }
    Value::Object(message)
}

/// The JSON schema of a channel's messages.
fn schema(channel: Channel, series: &Series, columns: &[&Column]) -> Value {
    let mut joints = Map::new();
    for column in columns {
        let joint = joints
            .entry(joint_key(series, column.joint))
            .or_insert_with(|| json!({"type": "object", "properties": {}}));
        joint["properties"][&column.quantity] = json!({"type": "number", "description": column.meaning});
    }
    json!({"title": channel.topic().trim_start_matches('/'), "type": "object", "properties": joints})
}

fn metadata(recording: &Recording, robot: &Robot) -> BTreeMap<String, String> {
    let mut metadata = BTreeMap::new();
    let mut put = |key: &str, value: String| drop(metadata.insert(key.to_string(), value));
    put("robot", robot.name.clone());
    put("exported_by", crate::TOOL_VERSION.into());
    put("record_period_s", robot.record_period_s.to_string());
    put("loop_period_s", robot.loop_period_s.to_string());
    if let Some(name) = recording.path.file_name() {
        put("file", name.to_string_lossy().into_owned());
    }
    for (joint, position_loop) in robot.joints.iter().zip(recording.position_loops(robot).unwrap_or_default()) {
        put(&format!("joint_{}_position_gain_a_per_count", joint.name), position_loop.gain_a_per_count.to_string());
        put(&format!("joint_{}_lead", joint.name), position_loop.lead.to_string());
    }
    let Some(manifest) = &recording.manifest else { return metadata };
    put("mode", manifest.mode.to_string());
    let texts =
        [("trajectory", &manifest.trajectory), ("recorded_by", &manifest.tool), ("firmware", &manifest.firmware)];
    for (key, text) in texts {
        if !text.is_empty() {
            put(key, text.clone());
        }
    }
    if let Some(seed) = manifest.seed {
        put("seed", seed.to_string());
    }
    for (key, text) in [("model_crc", &manifest.model_crc), ("partial", &manifest.partial)] {
        if let Some(text) = text {
            put(key, text.clone());
        }
    }
    metadata
}
