//! The bench's table for people.

use crate::{BenchReport, CostQuantiles, predictors, stepping};

fn pair(cost: &CostQuantiles) -> String {
    format!("{:.2} / {:.2}", cost.p50, cost.p99)
}

impl BenchReport {
    /// The table for people: the rows that were timed.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "µs, p50 / p99 of {} instances each, plans of {} steps; the clock's own {:.3} µs included\n",
            self.samples, self.horizon, self.clock_us
        )];
        for block in [self.solvers(), self.loops(), self.predictors()] {
            if !block.is_empty() && lines.len() > 1 {
                lines.push(String::new());
            }
            lines.extend(block);
        }
        lines
    }

    /// Every problem with each solver.
    fn solvers(&self) -> Vec<String> {
        let costs = &self.costs;
        let rows = [
            ("plan, no limit active", &costs.mpc_free_us),
            ("plan, 3-8 active", &costs.mpc_active_us),
            ("inverse kinematics", &costs.ik_us),
            ("predict", &costs.predict_us),
            ("whole step", &costs.step_us),
        ];
        let timed: Vec<_> = rows.iter().filter_map(|(name, row)| Some((name, row.as_ref()?))).collect();
        if timed.is_empty() {
            return Vec::new();
        }
        let mut lines = vec![format!(
            "{:<22} {:>15} {:>19} {:>8} {:>19} {:>8}",
            "", "exact", "Clarabel", "ratio", "Clarabel tuned", "ratio"
        )];
        for (name, row) in timed {
            let other = |cost: &Option<CostQuantiles>| cost.as_ref().map_or("-".to_owned(), pair);
            let ratio = |cost: &Option<CostQuantiles>| {
                cost.as_ref().map_or_else(String::new, |cost| format!("{:.0} x", cost.p50 / row.exact.p50))
            };
            lines.push(format!(
                "{:<22} {:>15} {:>19} {:>8} {:>19} {:>8}",
                name,
                pair(&row.exact),
                other(&row.clarabel),
                ratio(&row.clarabel),
                other(&row.clarabel_tuned),
                ratio(&row.clarabel_tuned)
            ));
        }
        lines
    }

    /// The whole step with each predictor, and what else a loop does.
    fn loops(&self) -> Vec<String> {
        let (costs, mut lines) = (&self.costs, Vec::new());
        if let Some(steps) = &costs.step_by_predictor_us {
            lines.push(format!(
                "{:<22} {:>15} {:>19} {:>19}",
                "whole step with", "any tick", "with a new preview", "with new weights"
            ));
            for stepping::PredictorSteps { predictor, any, new_preview, new_weights } in steps {
                let [any, preview, weights] = [any, new_preview, new_weights].map(pair);
                lines.push(format!("{predictor:<22} {any:>15} {preview:>19} {weights:>19}"));
            }
        }
        let mut row = |name: &str, cost: &CostQuantiles, note: &str| {
            lines.push(format!("{name:<22} {:>15}   {note}", pair(cost)));
        };
        if let Some(learn) = &costs.learn_us {
            row("learner's step", learn, "off the loop: all models, all bands");
        }
        if let Some(lag) = &costs.lag_us {
            let note = format!("{:.2} where a grid step closes", lag.p90);
            row("lag of the arm, a tick", &lag.per_tick, &note);
        }
        if let Some(evidence) = &costs.evidence_us {
            let note = format!("{} where a grid step closes", pair(&evidence.closing));
            row("trust evidence, a tick", &evidence.between, &note);
        }
        lines
    }

    fn predictors(&self) -> Vec<String> {
        let timed = self.costs.predictors_us.iter().flatten();
        let line = |predictors::PredictorCost { name, steps, us }: &predictors::PredictorCost| {
            let what = if *steps == 0 { "learn".to_owned() } else { format!("observe, {steps} steps") };
            format!("{name:<22} {:>15}   {what}", pair(us))
        };
        timed.map(line).collect()
    }
}
