//! What a mechanism is like, for tables.

use super::{Law, Load, Mechanism};

impl Mechanism {
    /// What it is made of, for tables.
    pub(crate) fn traits(&self) -> Vec<String> {
        let mut out = vec![if self.planar { "planar" } else { "spatial" }.to_owned()];
        out.push(if self.has_loops() { "loops" } else { "tree" }.to_owned());
        for joint in &self.joints {
            let name = format!("{:?}", joint.kind).to_lowercase();
            out.push(if joint.coordinates.is_none() { format!("loop {name}") } else { name });
        }
        for element in &self.elements {
            if let [Some(a), Some(b)] = element.between
                && self.root(a) != self.root(b)
            {
                out.push("a force between components".to_owned());
                let order = if a < b { "the nearer body first" } else { "the farther body first" };
                out.push(order.to_owned());
            }
            let law = match element.law {
                Law::Bushing(true) => "turning bushing".to_owned(),
                Law::Bushing(false) => "bushing".to_owned(),
                law => format!("{law:?}").to_lowercase(),
            };
            let decade = (element.stiffness.log10() / 3.0).floor() * 3.0;
            out.push(format!("{law} 1e{decade}"));
            out.push(law);
            let stiff = element.stiffness > 1e6;
            out.push(if stiff { "stiffer than 1e6" } else { "softer than 1e6" }.to_owned());
            out.push(
                if element.damping == 0.0 { "an undamped element" } else { "a damped element" }
                    .to_owned(),
            );
            out.push(
                if element.settled { "a settled element" } else { "an unsettled element" }
                    .to_owned(),
            );
        }
        if self.elements.is_empty() {
            out.push("no springs".to_owned());
        }
        for load in &self.loads {
            out.push(
                match load {
                    Load::Force { .. } => "point force",
                    Load::Torque { .. } => "torque",
                    Load::Tyre { .. } => "tyre",
                }
                .to_owned(),
            );
        }
        if !self.drivers.is_empty() {
            out.push("driver".to_owned());
        }
        let fast = self.speed();
        out.push(
            match fast {
                _ if fast > 20.0 => "above 20 rad/s",
                _ if fast > 5.0 => "5 to 20 rad/s",
                _ => "below 5 rad/s",
            }
            .to_owned(),
        );
        out.push(format!("{} bodies", self.bodies.len()));
        out.sort();
        out.dedup();
        out
    }
}
