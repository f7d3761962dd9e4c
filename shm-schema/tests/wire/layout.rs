//! Size, alignment, offset and size of every field, as literal numbers. If one of these tests fails, the
//! layout has changed: raise the version in the type name, then change the numbers here.

use foretrace_shm::*;

pub(crate) fn pinned<T: Wire>(size: usize, align: usize, fields: &[(&str, usize, usize)], hash: u64) {
    let name = std::any::type_name::<T>();
    assert_eq!((size_of::<T>(), align_of::<T>()), (size, align), "{name}");
    let found: Vec<_> = T::FIELDS.iter().map(|field| (field.name, field.offset, field.size)).collect();
    assert_eq!(found, fields, "{name}");
    assert_eq!(T::LAYOUT_HASH, hash, "{name}: the type of a field has changed");
}

#[test]
fn layouts_are_pinned() {
    pinned::<Header>(
        24,
        8,
        &[("sequence", 0, 8), ("stamp_ns", 8, 8), ("boot_id", 16, 8)],
        0x4596befcfdd6aef1,
    );
    pinned::<PenSample>(
        64,
        8,
        &[
            ("header", 0, 24),
            ("device_stamp_ns", 24, 8),
            ("x_m", 32, 8),
            ("y_m", 40, 8),
            ("pressure", 48, 4),
            ("tilt_x_rad", 52, 4),
            ("tilt_y_rad", 56, 4),
            ("flags", 60, 4),
        ],
        0x218a2ce0e1479645,
    );
    pinned::<JointCommand>(
        168,
        8,
        &[
            ("header", 0, 24),
            ("published_ns", 24, 8),
            ("tick", 32, 8),
            ("valid_until_ns", 40, 8),
            ("pen_sequence", 48, 8),
            ("pen_stamp_ns", 56, 8),
            ("q", 64, 48),
            ("qd", 112, 48),
            ("mode", 160, 4),
            ("flags", 164, 4),
        ],
        0xed124580c0d91ddc,
    );
    pinned::<JointState>(
        272,
        8,
        &[
            ("header", 0, 24),
            ("robot_stamp_ns", 24, 8),
            ("command_tick", 32, 8),
            ("command_accepted_ns", 40, 8),
            ("pen_sequence", 48, 8),
            ("pen_stamp_ns", 56, 8),
            ("commands_received", 64, 8),
            ("commands_refused", 72, 8),
            ("q", 80, 48),
            ("qd", 128, 48),
            ("effort", 176, 48),
            ("safety_mode", 224, 4),
            ("robot_mode", 228, 4),
            ("effort_unit", 232, 4),
            ("note", 236, 4),
            ("line", 240, 32),
        ],
        0x0efc79305fe0c832,
    );
    pinned::<NoteWords>(384, 1, &[("text", 0, 192), ("to_do", 192, 192)], 0x2ecd84fa5adb2537);
    pinned::<ArmNote>(
        424,
        8,
        &[("header", 0, 24), ("since_ns", 24, 8), ("number", 32, 4), ("reserved", 36, 4), ("words", 40, 384)],
        0x6466424bf88b2a84,
    );
    pinned::<Enable>(32, 8, &[("header", 0, 24), ("stop", 24, 4), ("reserved", 28, 4)], 0x3c1fff8545064dfc);
    pinned::<PredictorName>(28, 1, &[("bytes", 0, 28)], 0x08c660f65a7c8001);
    pinned::<Rejections>(72, 8, &[("by_reason", 0, 72)], 0xc82e1bda91481e4d);
    pinned::<Counters>(
        392,
        8,
        &[
            ("ticks", 0, 8),
            ("overruns", 8, 8),
            ("skipped_ticks", 16, 8),
            ("shed_ticks", 24, 8),
            ("commands_sent", 32, 8),
            ("commands_failed", 40, 8),
            ("pen_received", 48, 8),
            ("pen_dropped", 56, 8),
            ("pen_out_of_order", 64, 8),
            ("pen_outliers", 72, 8),
            ("pen_gaps", 80, 8),
            ("pen_deferred_ticks", 88, 8),
            ("pen_rejected", 96, 72),
            ("joint_state_received", 168, 8),
            ("joint_state_dropped", 176, 8),
            ("joint_state_stale", 184, 8),
            ("joint_state_rejected", 192, 72),
            ("enable_rejected", 264, 8),
            ("enable_dropped", 272, 8),
            ("receive_failures", 280, 8),
            ("telemetry_ring_dropped", 288, 8),
            ("telemetry_failed", 296, 8),
            ("learner_ring_dropped", 304, 8),
            ("weights_refused", 312, 8),
            ("weights_overtaken", 320, 8),
            ("learner_events_lost", 328, 8),
            ("requests", 336, 8),
            ("requests_refused", 344, 8),
            ("allocations", 352, 8),
            ("connection_allocations", 360, 8),
            ("connection_ticks", 368, 8),
            ("page_faults_minor", 376, 8),
            ("page_faults_major", 384, 8),
        ],
        0x72b0303f9a1e080c,
    );
    pinned::<Chain>(
        40,
        8,
        &[
            ("pen_reader_ns", 0, 8),
            ("pen_transport_ns", 8, 8),
            ("pen_age_ns", 16, 8),
            ("compute_ns", 24, 8),
            ("command_transport_ns", 32, 8),
        ],
        0x73493b22b605ca88,
    );
    pinned::<ArmLine>(
        32,
        8,
        &[
            ("round_trip_ns", 0, 8),
            ("late_cycles", 8, 8),
            ("lost_commands", 16, 8),
            ("flags", 24, 4),
            ("reserved", 28, 4),
        ],
        0xf94b3ca95fcb86f4,
    );
    pinned::<ArmLag>(
        32,
        8,
        &[("dead_time_ns", 0, 8), ("lag_s", 8, 8), ("std_s", 16, 8), ("shift_s", 24, 8)],
        0x2557f6b82ef60069,
    );
    pinned::<Tracking>(
        40,
        8,
        &[
            ("recent_rms_m", 0, 8),
            ("session_rms_m", 8, 8),
            ("hover_rms_m", 16, 8),
            ("recent_lag_s", 24, 8),
            ("session_lag_s", 32, 8),
        ],
        0x6e01a9bec75bd4a7,
    );
    pinned::<TickRecord>(
        1384,
        8,
        &[
            ("header", 0, 24),
            ("tick", 24, 8),
            ("release_ns", 32, 8),
            ("command_stamp_ns", 40, 8),
            ("slack_ns", 48, 8),
            ("stage_ns", 56, 40),
            ("budget_mpc_iterations", 96, 4),
            ("budget_ik_iterations", 100, 4),
            ("shed", 104, 4),
            ("skipped_ticks", 108, 4),
            ("pen_sequence", 112, 8),
            ("pen_stamp_ns", 120, 8),
            ("chain", 128, 40),
            ("pen_m", 168, 24),
            ("pen_samples", 192, 4),
            ("pen_flags", 196, 4),
            ("joint_state_age_ns", 200, 8),
            ("measured_q", 208, 48),
            ("echo_tick", 256, 8),
            ("echo_pen_sequence", 264, 8),
            ("echo_pen_stamp_ns", 272, 8),
            ("reference_m", 280, 24),
            ("setpoint_m", 304, 24),
            ("setpoint_mps", 328, 24),
            ("setpoint_mps2", 352, 24),
            ("jerk_mps3", 376, 24),
            ("tool_m", 400, 24),
            ("q", 424, 48),
            ("qd", 472, 48),
            ("trust", 520, 8),
            ("trust_target", 528, 8),
            ("confidence", 536, 8),
            ("trust_reason", 544, 4),
            ("rung", 548, 4),
            ("mode", 552, 4),
            ("fault", 556, 4),
            ("health", 560, 4),
            ("guard_mask", 564, 4),
            ("guard_joints", 568, 4),
            ("mpc_soft", 572, 4),
            ("mpc_active", 576, 12),
            ("mpc_iterations", 588, 12),
            ("mpc_path", 600, 12),
            ("ik_active", 612, 4),
            ("ik_iterations", 616, 4),
            ("ik_path", 620, 4),
            ("mpc_residual", 624, 24),
            ("ik_residual", 648, 8),
            ("orientation_error_rad", 656, 8),
            ("singularity_m", 664, 8),
            ("predictor_error_m", 672, 8),
            ("predictor_band_m", 680, 8),
            ("learner_version", 688, 8),
            ("learner_age_ns", 696, 8),
            ("predictor", 704, 28),
            ("preview_steps", 732, 4),
            ("allocations", 736, 4),
            ("connections_changed", 740, 4),
            ("counters", 744, 392),
            ("arm_lag", 1136, 32),
            ("ghost_tool_m", 1168, 24),
            ("compared_ns", 1192, 8),
            ("error_m", 1200, 8),
            ("ghost_error_m", 1208, 8),
            ("ghost_state", 1216, 4),
            ("compared_contact", 1220, 4),
            ("stop", 1224, 32),
            ("arm_speed_share", 1256, 8),
            ("arm_line", 1264, 32),
            ("path_points", 1296, 4),
            ("reserved", 1300, 4),
            ("path_m", 1304, 80),
        ],
        0x5a119bb3110be1e1,
    );
    pinned::<Percentiles>(
        16,
        4,
        &[("p50_ns", 0, 4), ("p99_ns", 4, 4), ("p99_9_ns", 8, 4), ("max_ns", 12, 4)],
        0x1f3d04f1cb1a7002,
    );
    pinned::<StopDetail>(
        32,
        8,
        &[("cause", 0, 4), ("joint", 4, 4), ("amount", 8, 8), ("limit", 16, 8), ("at_ns", 24, 8)],
        0x7b451d9176881284,
    );
    pinned::<ToolExtent>(
        32,
        8,
        &[("height_min_m", 0, 8), ("height_max_m", 8, 8), ("outside_max_m", 16, 8), ("tilt_max_rad", 24, 8)],
        0x10c63dc9a6875811,
    );
    pinned::<Refused>(
        40,
        8,
        &[
            ("reason", 0, 4),
            ("field", 4, 4),
            ("index", 8, 4),
            ("reserved", 12, 4),
            ("value", 16, 8),
            ("bound", 24, 8),
            ("at_ns", 32, 8),
        ],
        0x3cdab4209f9122a2,
    );
    pinned::<Latency>(
        104,
        8,
        &[("count", 0, 8), ("percentiles", 8, 16), ("bins", 24, 80)],
        0xe164e187ba0ec90a,
    );
    pinned::<WayHome>(
        32,
        8,
        &[("farthest_rad", 0, 8), ("left_s", 8, 8), ("share", 16, 8), ("joint", 24, 4), ("moving", 28, 4)],
        0x795854b8ed6ab48c,
    );
    pinned::<Status>(
        2048,
        8,
        &[
            ("header", 0, 24),
            ("daemon_id", 24, 8),
            ("pid", 32, 4),
            ("mode", 36, 4),
            ("fault", 40, 4),
            ("missing_rights", 44, 4),
            ("rate_hz", 48, 8),
            ("measured_rate_hz", 56, 8),
            ("tick", 64, 8),
            ("uptime_ns", 72, 8),
            ("settings_revision", 80, 8),
            ("settings_hash", 88, 8),
            ("stages", 96, 160),
            ("counters", 256, 392),
            ("trust", 648, 8),
            ("trust_target", 656, 8),
            ("trust_reason", 664, 4),
            ("predictor", 668, 28),
            ("pen_age_ns", 696, 8),
            ("joint_state_age_ns", 704, 8),
            ("chain", 712, 40),
            ("pen_to_command", 752, 104),
            ("command_to_motion", 856, 104),
            ("learner_version", 960, 8),
            ("learner_updates", 968, 8),
            ("learner_promotions", 976, 8),
            ("learner_rollbacks", 984, 8),
            ("learner_refused", 992, 8),
            ("learner_age_ns", 1000, 8),
            ("predictor_rms_m", 1008, 8),
            ("predictor_band_m", 1016, 8),
            ("arm_lag", 1024, 32),
            ("tracking", 1056, 40),
            ("ghost", 1096, 40),
            ("compared_s", 1136, 8),
            ("ghost_state", 1144, 4),
            ("ghost_cost_ns", 1148, 4),
            ("allocations_per_tick", 1152, 8),
            ("stop", 1160, 32),
            ("extent", 1192, 32),
            ("arm_speed_share", 1224, 8),
            ("pen_refused", 1232, 40),
            ("joints_refused", 1272, 40),
            ("enable_refused", 1312, 40),
            ("echo_refused", 1352, 40),
            ("way_home", 1392, 32),
            ("arm_line", 1424, 32),
            ("joints_q", 1456, 48),
            ("tool_base", 1504, 48),
            ("tool_plane_m", 1552, 24),
            ("note_since_ns", 1576, 8),
            ("note", 1584, 384),
            ("external", 1968, 80),
        ],
        0x715fb3bed0407dc8,
    );
    pinned::<ControlRequest>(
        64,
        8,
        &[
            ("token", 0, 8),
            ("sent_ns", 8, 8),
            ("boot_id", 16, 8),
            ("value", 24, 8),
            ("op", 32, 4),
            ("predictor", 36, 28),
        ],
        0xf9b5cd3f68c7b39e,
    );
    pinned::<ControlResponse>(
        208,
        8,
        &[
            ("token", 0, 8),
            ("boot_id", 8, 8),
            ("daemon_id", 16, 8),
            ("value", 24, 8),
            ("status", 32, 4),
            ("detail", 36, 4),
            ("message_len", 40, 4),
            ("reserved", 44, 4),
            ("message", 48, 160),
        ],
        0xa9d61ad46e5ce2f7,
    );
}

#[test]
fn what_ticks_wait_for_fits_a_quarter_of_a_page_and_the_rest_half_of_one() {
    for size in [size_of::<TickRecord>(), size_of::<Status>()] {
        assert!(size <= 2048, "{size}");
    }
    for size in [size_of::<PenSample>(), size_of::<JointCommand>(), size_of::<JointState>()] {
        assert!(size <= 1024, "{size}");
    }
}

#[test]
fn layouts_of_recorded_inputs_are_pinned() {
    pinned::<PenInput>(
        56,
        8,
        &[
            ("stamp_ns", 0, 8),
            ("x_m", 8, 8),
            ("y_m", 16, 8),
            ("sequence", 24, 8),
            ("sent_ns", 32, 8),
            ("received_ns", 40, 8),
            ("contact", 48, 4),
            ("reserved", 52, 4),
        ],
        0x8d484428f616a6a6,
    );
    pinned::<TickInput>(
        912,
        8,
        &[
            ("header", 0, 24),
            ("daemon_id", 24, 8),
            ("tick", 32, 8),
            ("now_ns", 40, 8),
            ("part", 48, 4),
            ("parts", 52, 4),
            ("pen_samples", 56, 4),
            ("flags", 60, 4),
            ("budget_iterations", 64, 4),
            ("request", 68, 4),
            ("request_value", 72, 8),
            ("request_predictor", 80, 28),
            ("halt", 108, 4),
            ("halt_detail", 112, 32),
            ("joints_ns", 144, 8),
            ("joints_q", 152, 48),
            ("joints_qd", 200, 48),
            ("joints_effort", 248, 48),
            ("effort_unit", 296, 4),
            ("reserved", 300, 4),
            ("enable_ns", 304, 8),
            ("weights_version", 312, 8),
            ("command_ns", 320, 8),
            ("valid_until_ns", 328, 8),
            ("q", 336, 48),
            ("qd", 384, 48),
            ("trust", 432, 8),
            ("weights_used", 440, 8),
            ("mode", 448, 4),
            ("rung", 452, 4),
            ("fault", 456, 4),
            ("health", 460, 4),
            ("pen", 464, 448),
        ],
        0x2aee40fa31bf27d1,
    );
    pinned::<Piece>(
        4168,
        8,
        &[
            ("header", 0, 24),
            ("daemon_id", 24, 8),
            ("number", 32, 8),
            ("total", 40, 8),
            ("offset", 48, 8),
            ("hash", 56, 8),
            ("kind", 64, 4),
            ("length", 68, 4),
            ("bytes", 72, 4096),
        ],
        0x6545d516a122c22d,
    );
}
