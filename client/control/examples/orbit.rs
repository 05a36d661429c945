//! Takes a wall's camera around the origin, and a thousand objects along with it, frame by frame.
//!
//! ```text
//! mullion serve WALL SCENE --control 127.0.0.1:7468
//! cargo run -p mullion-control --example orbit -- 127.0.0.1:7468 [FRAMES] [OBJECTS] [RADIUS_M]
//! ```

use std::f64::consts::TAU;

use glam::{DAffine3, DQuat, DVec3};
use mullion_control::{CameraAt, Command, Control, Error, Moved, ObjectId};

/// Frames that one turn takes.
const TURN: f64 = 600.0;

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |place: usize, otherwise: u32| arguments.get(place).and_then(|text| text.parse().ok()).unwrap_or(otherwise);
    let address = arguments.first().map_or("127.0.0.1:7468", String::as_str);
    let (frames, objects, radius_m) = (number(1, 600), number(2, 1000), f64::from(number(3, 20)));
    let mut control = Control::connect(address)?;
    for step in 0..frames {
        let angle = TAU * f64::from(step) / TURN;
        let around = DQuat::from_rotation_y(angle);
        let moves: Vec<Moved> = (0..objects)
            .map(|object| {
                let own = DQuat::from_rotation_y(angle + TAU * f64::from(object) / f64::from(objects));
                let height = DVec3::Y * f64::from(object % 10);
                let transform = DAffine3::from_rotation_translation(own, own * DVec3::Z * radius_m / 2.0 + height).into();
                Moved { object: ObjectId(object), transform }
            })
            .collect();
        control.move_objects(&moves)?;
        let translation = (around * DVec3::Z * radius_m).to_array();
        let camera = CameraAt { translation, rotation: around.to_array(), scale: 1.0 };
        // Waits for the frame that takes it: the wall's rate is this loop's.
        let frame = control.send(&[Command::Camera(camera)])?;
        if step % 60 == 0 {
            println!("frame {frame}: {} of {} nodes", control.status().connected, control.status().nodes.len());
        }
    }
    control.send(&[Command::FollowPath])?;
    Ok(())
}
