//! As `layout`, of the messages of predictors in other processes.

use foretrace_shm::*;

use crate::layout::pinned;

#[test]
fn layouts_of_predictors_in_other_processes_are_pinned() {
    pinned::<ExternalState>(
        80,
        4,
        &[
            ("weight", 0, 4),
            ("evidence", 4, 4),
            ("share", 8, 4),
            ("steps", 12, 4),
            ("hits", 16, 4),
            ("taken", 20, 4),
            ("lost", 24, 4),
            ("unsent", 28, 4),
            ("refused", 32, 32),
            ("latency", 64, 16),
        ],
        0x813f38b87fbb2847,
    );
    pinned::<PenStep>(
        112,
        8,
        &[
            ("header", 0, 24),
            ("index", 24, 8),
            ("time_ns", 32, 8),
            ("step_ns", 40, 8),
            ("x_m", 48, 8),
            ("y_m", 56, 8),
            ("dx_m", 64, 8),
            ("dy_m", 72, 8),
            ("scale_m", 80, 8),
            ("longest_m", 88, 8),
            ("motion", 96, 4),
            ("contact", 100, 4),
            ("wanted", 104, 4),
            ("reserved", 108, 4),
        ],
        0xd01102306f4281a3,
    );
    pinned::<PenPreview>(
        1576,
        8,
        &[
            ("header", 0, 24),
            ("base_index", 24, 8),
            ("count", 32, 4),
            ("flags", 36, 4),
            ("x_m", 40, 512),
            ("y_m", 552, 512),
            ("radius_m", 1064, 512),
        ],
        0x71e9d0a61008ee18,
    );
}
