"""Everything that differs from robot to robot. Edit this file, copy it to the board, reset the board."""

# -- what is wired to the board --------------------------------------------------------------------
# Set what you do not have to False: its topics are then not published.
HAS_WHEELS = True
HAS_IMU = True  # MPU6050, MPU6500, MPU9250, ICM-20689, ...
HAS_TOF = True  # VL6180X: distance up to 20 cm, and light
HAS_SONAR = True  # HC-SR04: distance up to 4 m

# -- pins (numbers of GPIO, not of the pins of the chip) --------------------------------------------
# Wheels in this order everywhere: front left, front right, rear left, rear right.
# Two pins for a motor: the two inputs of its half of a DRV8833 or L298N, both get PWM.
# Three pins: PWM input, then the two direction inputs, as of a TB6612FNG: (8, 9, 10).
MOTOR_PINS = ((8, 9), (10, 11), (12, 13), (14, 15))
MOTOR_SIGNS = (1, 1, 1, 1)  # -1: this motor turns the wrong way
ENCODER_PINS = ((2, 3), (6, 7), (16, 17), (18, 19))  # channel A, channel B
ENCODER_SIGNS = (1, 1, 1, 1)  # -1: this encoder counts down when the wheel turns forward
I2C = 0
I2C_SDA_PIN = 4
I2C_SCL_PIN = 5
SONAR_TRIGGER_PIN = 20
SONAR_ECHO_PIN = 21  # 5 V! see the wiring table: it needs two resistors

# -- the robot --------------------------------------------------------------------------------------
WHEEL_RADIUS_M = 0.04
LEVER_M = 0.2  # half the wheelbase plus half the track
# Counts of channel A, up and down, for one turn of the wheel: 2 * pulses of the encoder * gear ratio.
COUNTS_PER_TURN = 2 * 11 * 90
MAX_WHEEL_RAD_S = 20.0  # of a wheel at full power, lifted from the floor
MAX_POWER = 1.0  # 0.5: never give a motor more than half
COMMAND_TIMEOUT_MS = 500  # without a new cmd_vel for so long the motors stop

# -- speed loop of a wheel ---------------------------------------------------------------------------
SPEED_P = 0.03  # power for 1 rad/s too slow
SPEED_I = 0.3  # power for 1 rad too late
SPEED_FILTER_S = 0.03
PWM_HZ = 20000

# -- topics: how often, and whether what gets lost on the line is sent again --------------------------
# Samples of more than 496 bytes (odom) have to be reliable; what is not reliable costs the board less time.
RATES_HZ = {
    "joint_states": 50,
    "imu/data_raw": 50,
    "odom": 20,
    "sensors/range_tof": 10,
    "sensors/range_ultrasonic": 10,
    "sensors/illuminance": 5,
}
RELIABLE = ("odom",)
CONTROL_HZ = 50  # of the speed loops

# -- sensors ------------------------------------------------------------------------------------------
# Which axis of the chip points forward, to the left, up: 0 is x, 1 is y, 2 is z, with its sign.
IMU_AXES = ((0, 1), (1, 1), (2, 1))
IMU_GYRO_VARIANCE = 1e-5  # (rad/s)^2
IMU_ACCEL_VARIANCE = 1e-3  # (m/s^2)^2
ODOM_POSE_VARIANCES = (1e-3, 1e-3, 1e6, 1e6, 1e6, 1e-2)  # x, y, z, roll, pitch, yaw
ODOM_TWIST_VARIANCES = (1e-3, 1e-3, 1e6, 1e6, 1e6, 1e-2)

# -- the line to the computer ---------------------------------------------------------------------------
NAME = "pico"
UART = (
    None  # None: USB. A number: that UART, on the pins below, so that USB stays free for the REPL
)
UART_BAUD = 460800
UART_TX_PIN = 0
UART_RX_PIN = 1
# A program that hangs resets the board after so many ms, which stops the motors; 0: never. It cannot be
# switched off again but by a reset, so leave it off until the robot is ready; at most 8000.
WATCHDOG_MS = 0
