//! A simulated UR controller: the ports, the program, the arm.
