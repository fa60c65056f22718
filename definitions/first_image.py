"""The process image before the first scan of a bench, which writes it in place from then on."""

from __future__ import annotations

from definitions.image import AGE_NEVER, Image, NmtState, SampleStatus


def first_image() -> Image:
    """Return the image before anything has arrived; of the drive a heartbeat has been heard."""
    return Image(
        missed_periods=0,
        command=0,
        drive_state=0,
        drive_statusword=0,
        drive_mode=0,
        drive_internal_limit=0,
        drive_follows_command=0,
        drive_homing_attained=0,
        drive_homing_error=0,
        drive_torque_nm=0.0,
        drive_angle_rad=0.0,
        drive_velocity_rad_s=0.0,
        drive_age_scans=AGE_NEVER,
        drive_nmt_state=int(NmtState.OPERATIONAL),
        drive_heartbeat_age_scans=0,
        drive_emcy_code=0,
        drive_error_register=0,
        torque_in_nm=0.0,
        torque_out_nm=0.0,
        angle_in_rad=0.0,
        angle_out_rad=0.0,
        sample_counter=0,
        sample_time_us=0,
        sample_status=int(SampleStatus.NOT_READY),
        sample_age_scans=AGE_NEVER,
        brake_current_a=0.0,
        brake_on=0,
        brake_age_scans=AGE_NEVER,
        estop_released=0,
        guard_closed=0,
        housing_temp_c=0.0,
        ambient_temp_c=0.0,
        io_age_scans=AGE_NEVER,
        links_lost=0,
    )
